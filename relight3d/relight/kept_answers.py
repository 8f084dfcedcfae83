"""What the last lights' rays found: a light that did not move casts none."""

from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

Answer = TypeVar("Answer")


class KeptAnswers(Generic[Answer]):
    """The answers of the last lights, as many as a frame needs, and the rays of those asked for since `start_frame`."""

    def __init__(self, keep_lights: int) -> None:
        self._least = self._room = keep_lights
        self._kept: OrderedDict[tuple, Answer] = OrderedDict()
        self.rays: dict[str, int] = {}

    def start_frame(self, num_kept: int) -> None:
        """Begin counting rays anew; the frame needs the answers of so many lights, mirrored ones counted."""
        self.rays = {"shadow": 0, "border": 0, "thrown": 0}
        self._room = max(num_kept, self._least)

    def forget(self) -> None:
        """Answers from now on are made in another way."""
        self._kept.clear()

    def keep(self, key: tuple, make: Callable[[], Answer]) -> Answer:
        """The answer of a light, made where it is not known; the one asked for longest ago makes room."""
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        while len(self._kept) >= self._room:
            self._kept.popitem(last=False)
        self._kept[key] = make()
        return self._kept[key]
