"""Things tried beside each other, each in a copy of the code of its own."""

import contextlib
import queue
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from tests.mutants.tree import Tree, tree

Item = TypeVar("Item")
Found = TypeVar("Found")


class Copies:
    """Of the code, in each of which one thing at a time is tried."""

    def __init__(self, trees: Iterable[Tree], pool: ThreadPoolExecutor) -> None:
        self._pool = pool
        self._idle: queue.SimpleQueue[Tree] = queue.SimpleQueue()
        for one in trees:
            self._idle.put(one)

    def try_each(
        self, attempt: Callable[[Tree, Item], Found], items: Iterable[Item]
    ) -> Iterator[Found]:
        """What is found of each item, in their order."""

        def one(item: Item) -> Found:
            copy = self._idle.get()
            try:
                return attempt(copy, item)
            finally:
                self._idle.put(copy)

        return self._pool.map(one, items)


@contextlib.contextmanager
def copies(count: int) -> Iterator[Copies]:
    """So many, which are gone afterwards; what has not begun when the body ends is not tried."""
    with contextlib.ExitStack() as stack:
        trees = [stack.enter_context(tree()) for _ in range(count)]
        pool = ThreadPoolExecutor(count)
        stack.callback(pool.shutdown, cancel_futures=True)
        yield Copies(trees, pool)
