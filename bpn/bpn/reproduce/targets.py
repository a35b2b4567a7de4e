"""All targets of `bpn reproduce`."""

from bpn.reproduce.averaging import AVERAGING
from bpn.reproduce.cartpole import CARTPOLE
from bpn.reproduce.definition import Target
from bpn.reproduce.heatmap import HEATMAP
from bpn.reproduce.inference import INFERENCE
from bpn.reproduce.latency import LATENCY
from bpn.reproduce.learning import REACHING, TRACKING
from bpn.reproduce.pan_tilt import PAN_TILT
from bpn.reproduce.robustness import ROBUSTNESS, ROBUSTNESS_PAN_TILT

TARGETS: dict[str, Target] = {
    target.name: target
    for target in (
        REACHING,
        TRACKING,
        HEATMAP,
        PAN_TILT,
        INFERENCE,
        LATENCY,
        AVERAGING,
        CARTPOLE,
        ROBUSTNESS,
        ROBUSTNESS_PAN_TILT,
    )
}
