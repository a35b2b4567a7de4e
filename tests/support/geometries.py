"""Networks of every size that a test asks for."""

from collections.abc import Sequence

from hypothesis import strategies as st

from bpn_shared.spec.network import NetworkSpec


def geometries(
    channels: Sequence[int], hidden_units: int, actions: int
) -> st.SearchStrategy[NetworkSpec]:
    """Those with one of these numbers of channels, and up to so many hidden units and actions."""
    return st.builds(
        NetworkSpec,
        channels=st.sampled_from(channels),
        hidden_units=st.integers(1, hidden_units),
        actions=st.integers(2, actions),
    )
