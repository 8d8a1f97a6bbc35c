"""Which messages belong to the run that a node shows."""

from __future__ import annotations


class ShownRun:
    """Decides by the announcements of runs, and by the stamps of samples.

    Times of publication are on the wall clock [ns]; only those of one machine are compared.

    Attributes
    ----------
    name : str
        Name of the run in its announcement; '' before the first, or while another is awaited.
    """

    def __init__(self) -> None:
        self.name = ''
        self._start_ns = 0
        self._announced_ns = self._replaced_ns = 0
        self._awaits_truth = False

    def announce(self, name: str, start_ns: int, published_ns: int) -> bool:
        """Note a run that starts at the stamp `start_ns`; return whether it is shown from now on.

        It is not if another run has been requested since.
        """
        self._announced_ns = max(self._announced_ns, published_ns)
        if self.is_awaited:
            return False
        self.name, self._start_ns = name, start_ns
        self._awaits_truth = True
        return True

    def replace(self, published_ns: int) -> None:
        """Note the request of another run, published at this time."""
        self._replaced_ns = published_ns
        if self.is_awaited:
            self.name = ''

    @property
    def is_awaited(self) -> bool:
        """Whether a requested run is still to be announced."""
        return self._replaced_ns > self._announced_ns

    def includes(self, stamp_ns: int, *, is_truth: bool) -> bool:
        """Return whether a sample belongs to the run; `is_truth` marks those of the plant.

        Participants may still answer the last tick of the run before, until the plant has published
        the first truth of the new one. Later stamps may be earlier: a player has jumped back.
        """
        if self._awaits_truth and stamp_ns < self._start_ns:
            return False
        self._awaits_truth = self._awaits_truth and not is_truth
        return True
