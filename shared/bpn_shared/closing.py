"""What has to be closed, and is when a `with` ends."""

from typing import Self


class Closing:
    """A context manager whose end is `close`."""

    def close(self) -> None:
        """Ends it. Closing it again does nothing."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
