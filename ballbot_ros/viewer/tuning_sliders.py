"""The sliders of a live page for the parameters that a controller takes over during a run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import viser

_STEPS = 200
"""Steps of a slider for real numbers."""

_NARROW = 10.0
"""A slider covers the bounds if they are at most this many times as far apart as its value."""

_WHOLE_SPAN = 1000.0
"""A slider for whole numbers covers bounds that are at most this far apart."""

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class Tunable:
    """A parameter that can be tuned.

    Attributes
    ----------
    description : str
        Its meaning and unit.
    low, high : float
        Its bounds, the same for each number.
    start, value : tuple of float
        Its numbers at the start of the run, and now; a single one unless it is an array.
    is_whole, is_array : bool
        Whether its numbers are integers, and whether it is an array.
    """

    name: str
    description: str
    low: float
    high: float
    start: Numbers
    value: Numbers
    is_whole: bool = False
    is_array: bool = False

    @classmethod
    def of(
        cls, name: str, hint: str, bounds: Any, start: Any, value: Any, *, is_whole: bool
    ) -> Tunable:
        """Return a parameter whose bounds are None for none, and its values numbers or arrays."""
        low, high = bounds or (-math.inf, math.inf)
        both = numbers_of(start), numbers_of(value)
        return cls(name, hint, low, high, *both, is_whole, is_array=hasattr(value, '__len__'))

    def range_of(self, value: float) -> tuple[float, float]:
        """Return the range of a slider for a value: the bounds, or part of them around it."""
        narrow = _WHOLE_SPAN if self.is_whole else _NARROW * max(abs(value), 1.0)
        if self.high - self.low <= narrow:
            return self.low, self.high
        reach = 2.0 * value or 1.0
        low, high = min(0.0, reach), max(0.0, reach)
        return max(self.low, low), min(self.high, high)

    def value_of(self, numbers: Numbers) -> float | int | list[float]:
        """Return numbers as the value of the parameter."""
        if self.is_array:
            return list(numbers)
        return round(numbers[0]) if self.is_whole else numbers[0]

    def step_of(self, low: float, high: float) -> float:
        """Return the step of a slider."""
        return 1.0 if self.is_whole or low == high else (high - low) / _STEPS


def numbers_of(value: Any) -> Numbers:
    """Return the numbers of a value."""
    return tuple(value) if hasattr(value, '__len__') else (value,)


FOLDER = 'Tuning'
RESTORE = 'Back to the start'


class TuningSliders:
    """A folder with a slider for each number; hidden if there is none."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self._folder = gui.add_folder(FOLDER, order=3.5, visible=False, expand_by_default=False)
        self._tunables: dict[str, Tunable] = {}
        self._sliders: dict[str, list[Any]] = {}
        self._restore: Any = None
        self._values: dict[str, Numbers] = {}
        self._wanted: dict[str, Numbers] = {}

    def show(self, tunables: Sequence[Tunable]) -> None:
        """Show these parameters instead of the present ones."""
        for slider in (slider for group in self._sliders.values() for slider in group):
            slider.remove()
        if self._restore:
            self._restore.remove()
        self._wanted.clear()
        self._tunables = {each.name: each for each in tunables}
        with self._folder:
            self._sliders = {each.name: self._add(each) for each in tunables}
            self._values = {each.name: each.value for each in tunables}
            self._restore = self._gui.add_button(RESTORE) if tunables else None
        if self._restore:
            self._restore.on_click(lambda _: self._go_back())
        self._folder.visible = bool(tunables)

    def _add(self, tunable: Tunable) -> list[Any]:
        sliders = []
        for index, value in enumerate(tunable.value):
            low, high = tunable.range_of(value)
            slider: Any = self._gui.add_slider(
                f'{tunable.name}[{index}]' if tunable.is_array else tunable.name,
                low,
                high,
                tunable.step_of(low, high),
                value,
                hint=tunable.description,
            )
            slider.on_update(lambda event, name=tunable.name: self._on_slider(event, name))
            sliders.append(slider)
        return sliders

    def _on_slider(self, event: Any, name: str) -> None:
        slider = event.target
        if event.client is None or name not in self._sliders:  # it follows another change
            return
        if slider.min <= slider.value <= slider.max:
            self._wanted[name] = self._values[name] = self._numbers(name)
        else:  # typed into the field next to it, which drops the minus sign
            self.follow({name: self._values[name]})

    def _go_back(self) -> None:
        for name, tunable in self._tunables.items():
            if self._numbers(name) != tunable.start:
                self.follow({name: tunable.start})
                self._wanted[name] = tunable.start

    def _numbers(self, name: str) -> Numbers:
        return tuple(slider.value for slider in self._sliders[name])

    def take(self) -> dict[str, Numbers]:
        """Return the newest numbers that the page wants, by parameter, since the last call."""
        return {name: self._wanted.pop(name) for name in list(self._wanted)}

    def follow(self, values: Mapping[str, Numbers]) -> None:
        """Move the sliders to new values, by the names of the parameters."""
        for name in values.keys() & self._sliders.keys():
            for slider, value in zip(self._sliders[name], values[name], strict=True):
                slider.min, slider.max = min(slider.min, value), max(slider.max, value)
                slider.value = value
            self._values[name] = values[name]
