"""Which kernel runs a run's policy: the edge's own choice, as far as the run does not ask for one."""

import subprocess
import sys
from itertools import permutations
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bpn_edge.fpga import connected, verilated
from bpn_edge.kernel import usable_kernels
from bpn_edge.kernel.choice import choose_kernel, kernels_here
from bpn_shared.errors import InputError
from bpn_shared.spec.config import ConfigError

KINDS = {"native": "binary", "golden": "binary", "onnx": "float"}
HERE = st.lists(st.sampled_from(sorted(KINDS)), unique=True).map(tuple)


@given(here=HERE, network=st.sampled_from(["binary", "float"]))
def test_of_what_an_edge_has_the_first_that_runs_the_network(
    here: tuple[str, ...], network: str
) -> None:
    fitting = [name for name in here if KINDS[name] == network]
    if here and not fitting:
        with pytest.raises(
            ConfigError, match=f"the run has a {network} network, and none of the kernels"
        ):
            choose_kernel("", network, here)  # type: ignore[arg-type]
        return
    default = "native" if network == "binary" else "onnx"
    assert choose_kernel("", network, here) == [*fitting, default][0]  # type: ignore[arg-type]


@pytest.mark.parametrize("here", [(), *permutations(["golden", "native"])])
def test_a_run_gets_what_it_asks_for(here: tuple[str, ...]) -> None:
    assert choose_kernel("golden", "binary", here) == "golden"


def test_an_edge_with_another_kernel_refuses_a_run_that_asks() -> None:
    """It gives its place back, and the registry offers that to the next."""
    with pytest.raises(
        ConfigError, match="asks for kernel 'native', this edge was set up with golden"
    ):
        choose_kernel("native", "binary", ("golden",))


def test_the_option_goes_before_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BPN_KERNEL", raising=False)
    assert kernels_here() == ()
    monkeypatch.setenv("BPN_KERNEL", "golden, onnx")
    assert kernels_here() == ("golden", "onnx")
    assert kernels_here("native,native") == ("native",)
    for given_, what in (
        ("fpga9", "kernel 'fpga9' is not installed here"),
        ("b;c", "'b;c' is no name"),
    ):
        with pytest.raises(InputError, match=what):
            kernels_here(given_)


def test_an_edge_that_is_set_up_wrongly_does_not_start() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "bpn_edge", "--kernel", "fpga9"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "kernel 'fpga9' is not installed here; there are: " in done.stderr


def test_a_kernel_that_runs_no_such_network_is_refused_before_weights_come() -> None:
    with pytest.raises(
        ConfigError, match="kernel = 'rtl' runs binary networks, the run's is float"
    ):
        choose_kernel("rtl", "float", ())


def test_a_circuit_is_named_only_where_there_is_what_it_needs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """An edge says which kernels it can use; a run that asks for one of them goes there."""
    monkeypatch.setattr(connected, "UIO", tmp_path)
    monkeypatch.delenv(connected.WHERE, raising=False)
    monkeypatch.setenv(verilated.CACHE, str(tmp_path / "models"))
    monkeypatch.setattr(verilated.importlib.util, "find_spec", lambda _: None)
    monkeypatch.setattr(verilated.shutil, "which", lambda _: None)
    assert not {"rtl", "fpga"} & set(usable_kernels())
    monkeypatch.setattr(verilated.shutil, "which", lambda name: f"/usr/bin/{name}")
    assert "rtl" in usable_kernels()
    (tmp_path / "uio0").mkdir()
    (tmp_path / "uio0/name").write_text("other\n")
    assert "fpga" not in usable_kernels()
    (tmp_path / "uio0/name").write_text("bpn\n")
    assert "fpga" in usable_kernels()
    monkeypatch.setenv(connected.WHERE, f"{tmp_path / 'mem'}@0xA0000000")
    assert "fpga" not in usable_kernels()
    (tmp_path / "mem").touch()
    assert "fpga" in usable_kernels()
