"""What `bpn-dashboard` refuses to be started with."""

import pytest

from bpn_certificates.authority import Validity, issue, new_authority
from bpn_dashboard.options import argument_parser, check_options
from bpn_shared.spec.config import ConfigError


@pytest.mark.parametrize(
    ("arguments", "wrong"),
    [
        ([], None),
        (["--host", "::1"], None),
        (["--host", "0.0.0.0"], "--insecure-http"),
        (["--host", "192.168.0.2"], "--insecure-http"),
        (["--host", "example.com"], "--insecure-http"),
        (["--host", "0.0.0.0", "--insecure-http"], None),
        (["--host", "0.0.0.0", "--certificate", "PEM", "--key", "PEM"], None),
        (["--certificate", "PEM"], "belong together"),
        (["--public-url", "https://robots.example.org"], None),
        (["--public-url", "http://[::1]:8000"], None),
        (["--public-url", "https://robots.example.org/bpn"], None),
        (["--public-url", "https://robots.example.org/labs/bpn-2"], None),
        (["--public-url", "http://localhost/bpn/"], "without a slash at its end"),
        (["--public-url", "http://localhost/../bpn"], "such as"),
        (["--public-url", "http://localhost/b%22pn"], "such as"),
        (["--public-url", "http://localhost/bpn?x=1"], "such as"),
        (["--public-url", "robots.example.org"], "such as http://localhost:8000"),
        (["--public-url", "http://localhost:8000/"], "such as"),
        (["--public-url", "http://localhost:port"], "such as"),
        (["--public-url", "http://me@localhost"], "such as"),
        (["--public-url", "ftp://localhost"], "such as"),
        (["--public-url", "http://:80"], "such as"),
        (["--certificate", "missing.pem", "--key", "PEM"], "missing.pem"),
        (["--certificate", "PEM", "--key", "EMPTY"], "are no PEM certificate with its key"),
    ],
)
def test_it_does_not_listen_beyond_loopback_in_the_clear(arguments, wrong, tmp_path) -> None:
    validity = Validity.of_days(1)
    own = issue(new_authority("a", validity), "dashboard", validity, server_names=["a.example"])
    (tmp_path / "PEM").write_bytes(own.certificate_pem() + own.key_pem())
    (tmp_path / "EMPTY").touch()
    files = {name: str(tmp_path / name) for name in ("PEM", "EMPTY")}
    options = argument_parser().parse_args([files.get(a, a) for a in arguments])
    if wrong is None:
        check_options(options)
    else:
        with pytest.raises(ConfigError, match=wrong):
            check_options(options)
