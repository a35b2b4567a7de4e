"""Networks of every size that a test asks for."""

from collections.abc import Sequence

from hypothesis import assume
from hypothesis import strategies as st

from bpn_shared.spec.network import Convolution, NetworkSpec


def geometries(
    channels: Sequence[int], hidden_units: int, actions: int
) -> st.SearchStrategy[NetworkSpec]:
    """The paper's shape with one of these numbers of channels, up to so many hidden units and actions."""
    return st.builds(
        NetworkSpec,
        channels=st.sampled_from(channels),
        hidden_units=st.integers(1, hidden_units),
        actions=st.integers(2, actions),
    )


@st.composite
def shapes(
    draw: st.DrawFn, *, image_px: int = 40, outputs: int = 20, hidden_units: int = 70
) -> NetworkSpec:
    """Convolutions of their own over images of up to so many pixels; actions of 1 to 4 dimensions."""
    size = whole = draw(st.integers(8, image_px))
    convolutions = []
    for _ in range(draw(st.integers(1, 4))):
        kernel = draw(st.integers(1, min(size, 16)))
        # one that keeps most positions comes with few channels
        stride = draw(st.integers(max(1, kernel // 4), kernel))
        convolutions.append(Convolution(kernel, stride, draw(st.integers(1, outputs))))
        size = (size - kernel) // stride + 1
    N = draw(st.integers(1, hidden_units))
    assume(size * size * convolutions[-1].channels * N < 300_000)  # the weights of FC(N)
    dims = draw(st.lists(st.integers(2, 9), min_size=1, max_size=4))
    return NetworkSpec(
        channels=draw(st.integers(1, 6)),
        hidden_units=N,
        actions=sum(dims),
        convolutions=tuple(convolutions),
        image_px=whole,
        action_dims=tuple(dims),
    )
