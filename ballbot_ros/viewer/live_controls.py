"""The controls of a live page: scenario and pushes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import viser

from ballbot_ros.plant.ground_truth import Pair
from ballbot_ros.viewer.drag import MAX_FORCE, MIN_FORCE

DIRECTIONS: dict[str, Pair] = {
    'forward': (1.0, 0.0),
    'back': (-1.0, 0.0),
    'left': (0.0, -1.0),
    'right': (0.0, 1.0),
}
"""Forward and rightward for each direction, in plane signs."""


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


class LiveControls:
    """The controls of a live page; `scenarios` are the choices for the next run."""

    def __init__(self, gui: viser.GuiApi, plant: PlantControls, scenarios: Sequence[str]) -> None:
        self._chooser = gui.add_folder('Scenario', order=1.5, visible=False)
        with self._chooser:
            self._next: Any = gui.add_dropdown('Next', tuple(scenarios))
            self._on_press(gui.add_button('Start'), lambda _: plant.start(self._next.value))
        with gui.add_folder('Push', order=2.0, expand_by_default=False):
            size = gui.add_slider('Force [N]', MIN_FORCE, MAX_FORCE, 0.1, 1.0)
            push = gui.add_button_group('Direction', tuple(DIRECTIONS))

            def give(name: str) -> None:
                x, y = DIRECTIONS[name]
                plant.push((x * size.value, y * size.value))

            self._on_press(push, give)

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
