"""The controls of a live page: time, speed, pushes and sticks."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import viser

from ballbot_ros.plant.ground_truth import Pair

PAUSE, STEP, RUN, RESET = TIME_BUTTONS = ('Pause', 'Step', 'Run', 'Reset')
SPEEDS = {'0.1×': 0.1, '0.5×': 0.5, '1×': 1.0, 'max': 0.0}
DIRECTIONS: dict[str, Pair] = {
    'forward': (1.0, 0.0),
    'back': (-1.0, 0.0),
    'left': (0.0, -1.0),
    'right': (0.0, 1.0),
}
"""Forward and rightward for each direction, in plane signs."""

_HOLD_HZ = 20.0
_RELEASE_S = 0.3
"""A stick counts as released when the page has been silent for this long."""


class PlantControls(Protocol):
    """What a page can ask of the plant; called from the page's threads."""

    def pause(self, pause: bool) -> None:
        """Pause the plant, or resume."""

    def step(self) -> None:
        """Run one tick of a paused plant."""

    def reset(self) -> None:
        """Begin a new run."""

    def set_real_time_factor(self, factor: float) -> None:
        """Set the real-time factor; 0 is as fast as possible."""

    def push(self, force: Pair) -> None:
        """Push the body with a force [N] in plane signs."""

    def start(self, scenario: str) -> None:
        """End the run, and start one of another scenario."""


class OnScreenSticks:
    """The on-screen sticks, held as long as the page keeps reporting them.

    A single report does not count: a browser slows a hidden page down to one report a second, and a
    hidden page must not drive.
    """

    def __init__(self) -> None:
        self._last_held: dict[str, tuple[float, float]] = {}

    def hold(self, direction: str, now_s: float) -> None:
        """Note that a direction is held at `now_s` [s]."""
        _, last = self._last_held.get(direction, (-math.inf, -math.inf))
        self._last_held[direction] = last, now_s

    def value(self, now_s: float) -> Pair | None:
        """Return forward and rightward, each −1 ... 1; None while no stick is held."""
        held = [
            DIRECTIONS[direction]
            for direction, (before, last) in self._last_held.copy().items()
            if now_s - last < _RELEASE_S and last - before < _RELEASE_S
        ]
        if not held:
            return None
        x, y = (max(-1.0, min(1.0, sum(values))) for values in zip(*held, strict=True))
        return x, y


class LiveControls:
    """The controls of a live page; `scenarios` are the choices for the next run."""

    def __init__(self, gui: viser.GuiApi, plant: PlantControls, scenarios: Sequence[str]) -> None:
        self.sticks = OnScreenSticks()
        acts: dict[str, Callable[[], None]] = {
            PAUSE: lambda: plant.pause(True),
            STEP: plant.step,
            RUN: lambda: plant.pause(False),
            RESET: plant.reset,
        }
        with gui.add_folder('Time', order=1.0):
            self._on_press(gui.add_button_group('Run', TIME_BUTTONS), lambda name: acts[name]())
            speed = gui.add_button_group('Speed', tuple(SPEEDS))
            self._on_press(speed, lambda name: plant.set_real_time_factor(SPEEDS[name]))
        self._chooser = gui.add_folder('Scenario', order=1.5, visible=False)
        with self._chooser:
            self._next: Any = gui.add_dropdown('Next', tuple(scenarios))
            self._on_press(gui.add_button('Start'), lambda _: plant.start(self._next.value))
        with gui.add_folder('Push', order=2.0, expand_by_default=False):
            size = gui.add_slider('Force [N]', 0.1, 3.0, 0.1, 1.0)
            push = gui.add_button_group('Direction', tuple(DIRECTIONS))

            def give(name: str) -> None:
                x, y = DIRECTIONS[name]
                plant.push((x * size.value, y * size.value))

            self._on_press(push, give)
        with gui.add_folder('Sticks (hold)', order=3.0, expand_by_default=False):
            self._strength = gui.add_slider('Stick [%]', 10, 100, 5, 50)
            for direction in DIRECTIONS:
                self._add_stick(gui, direction)

    def offer_scenarios(self, *, offer: bool) -> None:
        """Show the choice of the next scenario, or hide it."""
        if self._chooser.visible != offer:
            self._chooser.visible = offer

    def show_scenario(self, name: str) -> None:
        """Show the running scenario, if it is one of the choices."""
        if name in self._next.options:
            self._next.value = name

    @staticmethod
    def _on_press(buttons: Any, act: Callable[[str], None]) -> None:
        # A coroutine keeps the clicks in order: viser calls it before it handles the next click. It
        # would call a plain function in another thread.
        async def on_click(_: Any) -> None:
            act(buttons.value)

        buttons.on_click(on_click)

    def _add_stick(self, gui: viser.GuiApi, direction: str) -> None:
        button = gui.add_button(f'Drive {direction}', color='gray')

        @button.on_hold(callback_hz=_HOLD_HZ)
        def _(_: Any) -> None:
            self.sticks.hold(direction, time.monotonic())

    def drive(self, now_s: float) -> Pair | None:
        """Return the sticks forward and rightward, each −1 ... 1; None while no stick is held."""
        value = self.sticks.value(now_s)
        if value is None:
            return None
        strength = self._strength.value / 100.0
        return value[0] * strength, value[1] * strength
