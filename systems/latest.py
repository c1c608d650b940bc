"""The last answer of a costly pure function, kept for as long as the question stays the same.

Drake's cache forgets an answer as soon as anything in the state of the system that the question comes from was touched,
also where its value stayed the same: at every feedback period. Seconds of stereo would be lost each time.
"""

from collections.abc import Callable
from typing import Generic, TypeVar

Question = TypeVar("Question")
Answer = TypeVar("Answer")


class Latest(Generic[Question, Answer]):
    """Computes an answer anew only where the question differs from the last one."""

    def __init__(
        self,
        compute: Callable[[Question], Answer],
        same: Callable[[Question, Question], bool],
    ) -> None:
        """Nothing was asked yet.

        Args:
            compute: a function of the question alone.
            same: whether two questions must have the same answer.
        """
        self._compute, self._same = compute, same
        self._kept: tuple[Question, Answer] | None = None

    def __call__(self, question: Question) -> Answer:
        """Answer a question."""
        if self._kept is None or not self._same(self._kept[0], question):
            self._kept = (question, self._compute(question))
        return self._kept[1]
