"""The collector does nothing in an episode, takes what is left over between two, and is as before afterwards."""

import gc
import weakref

from bpn_shared.runtime.collector import Collector


class Knot:
    """Refers to itself, so that only the collector can free it."""

    def __init__(self) -> None:
        self.itself = self


def test_knots_are_freed_between_episodes_and_never_in_one() -> None:
    frozen = gc.get_freeze_count()
    with Collector() as collector:
        knot = weakref.ref(Knot())
        lists = [[] for _ in range(5000)]  # type: ignore[var-annotated]
        assert knot() is not None
        del lists
        collector.collect()
        assert knot() is None
    assert gc.isenabled()
    assert gc.get_freeze_count() <= frozen


def test_what_has_lived_for_some_episodes_is_freed_too() -> None:
    with Collector() as collector:
        kept = Knot()
        knot = weakref.ref(kept)
        for _ in range(3):
            collector.collect()
        del kept
        for _ in range(100):
            collector.collect()
        assert knot() is None
