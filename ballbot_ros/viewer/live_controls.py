"""The controls of a live page: scenario, pushes, sticks, and the transport bar."""

from __future__ import annotations

import math
from collections.abc import Callable, Coroutine, Sequence
from html import escape
from typing import Any

import numpy as np
import viser
from viser import SceneNodeDragEvent

from ballbot_ros.robot.brick.faults import COMPONENTS, EFFECTS, Effect, kind_of_component
from ballbot_ros.robot.plant.ground_truth import Pair
from ballbot_ros.viewer.overlay import MAX_HELD, Hold
from ballbot_ros.viewer.shapes import NEWTONS_PER_METRE, ForceArrow, Point

MIN_FORCE, MAX_FORCE = 0.1, 3.0
"""Smallest and largest force that a page can apply [N]."""

_STEEP = math.sin(math.radians(12.0))
"""Slope from which a line of sight meets the horizontal plane near enough."""


def drag_force(eye: Point, grip: Point, pointer: Point) -> Pair:
    """Return the force of a drag in plane signs [N], at most :data:`MAX_FORCE`.

    It is horizontal, and proportional to how far the drag pulls the robot.

    Parameters
    ----------
    eye, grip : sequence of float
        Position of the camera, and of the dragged point, in ``map`` [m].
    pointer : sequence of float
        A point under the pointer, on the plane through `grip` that faces the camera.
    """
    eye, grip, pointer = (np.asarray(point, float) for point in (eye, grip, pointer))
    with np.errstate(all='ignore'):  # a page may send any numbers
        sight = pointer - eye
        length = float(np.linalg.norm(sight))
        if sight[2] * (grip[2] - eye[2]) > 0.0 and abs(sight[2]) > _STEEP * length:
            pointer = eye + sight * ((grip[2] - eye[2]) / sight[2])
        force = NEWTONS_PER_METRE * (pointer - grip)[:2]
        size = float(np.linalg.norm(force))
    if not math.isfinite(size):
        return 0.0, 0.0
    x, y = (force * min(1.0, MAX_FORCE / size) if size else force).tolist()
    return x, -y


DragHandler = Callable[[SceneNodeDragEvent[Any]], Coroutine[Any, Any, None]]


def drag_push(arrow: ForceArrow, push: Callable[[Pair], None]) -> DragHandler:
    """Return what shows the force while a page drags the robot, and applies it at the release.

    `push` takes the force in plane signs [N].
    """

    # A coroutine, which viser calls in the order of the events.
    async def on_drag(event: SceneNodeDragEvent[Any]) -> None:
        grip = event.start_position
        force = drag_force(event.client.camera.position, grip, event.end_position)
        if event.phase != 'end':
            arrow.show(grip, force)
            return
        arrow.hide()
        if math.hypot(*force) >= MIN_FORCE:
            push(force)

    return on_drag


RELEASE_S = 0.3
"""A stick counts as released when its page has been silent for this long."""


class PageSticks:
    """The sticks of all pages, each held as long as its page keeps reporting it.

    A single report does not count: a browser slows a hidden page down to one report a second, and a
    hidden page must not drive.
    """

    def __init__(self) -> None:
        self._reports: dict[int, tuple[Hold | None, Hold]] = {}

    def hold(self, report: Hold) -> None:
        """Note a report."""
        _, last = self._reports.get(report.page, (None, None))
        self._reports[report.page] = last, report

    def value(self, now_s: float) -> Pair | None:
        """Return forward and rightward at `now_s` [s], each −1 ... 1; None if no stick is held.

        Sticks of several pages add up.
        """
        self._reports = {
            page: reports
            for page, reports in self._reports.items()
            if now_s - reports[1].at_s < RELEASE_S
        }
        held = [last for before, last in self._reports.values() if _is_held(before, last)]
        if not held:
            return None
        total = np.sum([(each.forward, each.rightward) for each in held], axis=0)
        forward, rightward = total.clip(-MAX_HELD, MAX_HELD).tolist()
        return forward, rightward


def _is_held(before: Hold | None, last: Hold) -> bool:
    is_repeated = before is not None and last.at_s - before.at_s < RELEASE_S
    return is_repeated and (last.forward, last.rightward) != (0.0, 0.0)


DIRECTIONS: dict[str, Pair] = {
    'forward': (1.0, 0.0),
    'back': (-1.0, 0.0),
    'left': (0.0, -1.0),
    'right': (0.0, 1.0),
}
"""Forward and rightward for each direction, in plane signs."""


def note(html: str) -> str:
    """Return a small note for a folder, as HTML."""
    return (
        '<div style="font-size:11px;line-height:1.35;opacity:0.7;margin:0 1em 0.6em;'
        f'overflow-wrap:anywhere">{html}</div>'
    )


def add_push_buttons(gui: viser.GuiApi, push: Callable[[Pair], None]) -> viser.GuiFolderHandle:
    """Add a folder with buttons that push the robot.

    The page's threads call `push` with a force on the body [N], in plane signs.
    """
    folder = gui.add_folder('Push', order=2.0, expand_by_default=False)
    with folder:
        size = gui.add_slider('Force [N]', MIN_FORCE, MAX_FORCE, 0.1, 1.0)
        directions = gui.add_button_group('Direction', tuple(DIRECTIONS))

        def give(name: str) -> None:
            x, y = DIRECTIONS[name]
            push((x * size.value, y * size.value))

        _on_press(directions, give)
    return folder


class FaultChooser:
    """A folder in which a fault is chosen that begins at once.

    The page's threads call `begin` with the fault, as an entry of the parameter `faults`.
    """

    def __init__(self, gui: viser.GuiApi, begin: Callable[[str], None]) -> None:
        self.folder = gui.add_folder('Fault', order=3.0, expand_by_default=False)
        with self.folder:
            self._component: Any = gui.add_dropdown('Component', COMPONENTS)
            self._type: Any = gui.add_dropdown('Type', tuple(EFFECTS['gyro']))
            self._meaning = gui.add_html('')
            self._amount: Any = gui.add_number('Amount', 0.0)
            self._duration = gui.add_number('Duration [s]', 1.0, min=0.0, hint='0: to the end')
            _on_press(gui.add_button('Begin'), lambda _: begin(self._text))
        self._component.on_update(lambda _: self._offer_types())
        self._type.on_update(lambda _: self._show_effect())
        self._show_effect()

    @property
    def _effect(self) -> Effect:
        return EFFECTS[kind_of_component(self._component.value)][self._type.value]

    @property
    def _text(self) -> str:
        words = [self._component.value, self._type.value]
        words += [f'amount={self._amount.value!r}'] if self._effect.amount else []
        words += [f'duration={self._duration.value!r}'] if self._duration.value else []
        return ' '.join(words)

    def _offer_types(self) -> None:
        types = tuple(EFFECTS[kind_of_component(self._component.value)])
        if types != self._type.options:
            self._type.options = types
        self._show_effect()

    def _show_effect(self) -> None:
        effect = self._effect
        unit = f' [{effect.amount.unit}]' if effect.amount else ''
        self._meaning.content = note(escape(effect.meaning + unit))
        self._amount.visible = effect.amount is not None
        if effect.amount:
            self._amount.value = effect.amount.default


class ScenarioChooser:
    """A folder in which the scenario of the next run is chosen, hidden at first.

    The page's threads call `start` with the choice: it ends the run, and starts another one.
    """

    def __init__(
        self, gui: viser.GuiApi, start: Callable[[str], None], scenarios: Sequence[str]
    ) -> None:
        self._chooser = gui.add_folder('Scenario', order=1.5, visible=False)
        with self._chooser:
            self._next: Any = gui.add_dropdown('Next', tuple(scenarios))
            _on_press(gui.add_button('Start'), lambda _: start(self._next.value))

    def offer(self, *, offer: bool) -> None:
        """Show the choice of the next scenario, or hide it."""
        if self._chooser.visible != offer:
            self._chooser.visible = offer

    def show(self, name: str) -> None:
        """Show the running scenario, if it is one of the choices."""
        if name in self._next.options:
            self._next.value = name


def _on_press(buttons: Any, act: Callable[[str], None]) -> None:
    # A coroutine keeps the clicks in order: viser calls it before it handles the next click. It
    # would call a plain function in another thread.
    async def on_click(_: object) -> None:
        act(buttons.value)

    buttons.on_click(on_click)
