"""`bpn verify`: recomputes what a run folder says, in plain code that shares nothing with learner and edge.

What it reads goes through `bpn_shared`'s readers; what it computes is written a second time here, from the
definitions in docs/verify.md, so that a fault in a part or in a call between parts shows as a difference.
"""
