"""The gamepad: stick signals of a scenario, or a neutral stick."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from ballbot_ros.messages.conversions import fill_sticks, time_ns
from ballbot_ros.messages.raw import stamp_of
from ballbot_ros.messages.topics import GAMEPAD_JOY, PLANT_JOINT_STATES, RUN
from ballbot_ros.nodes.base import BallbotNode, run_node
from ballbot_ros.parameters import GAMEPAD
from ballbot_ros.scenario.library import load_scenario
from ballbot_ros.scenario.scenario import Scenario
from ballbot_ros.simulation.lockstep import RunFollower
from ballbot_ros.simulation.timing import SLOW_NS


class GamepadTeleop(BallbotNode):
    """Answers ``plant/joint_states`` at multiples of 20 ms with one ``gamepad`` of that stamp."""

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        super().__init__(GAMEPAD, values)
        name = self.values['scenario']
        self._scenario = load_scenario(name) if name else Scenario()
        self._run = RunFollower()
        # Free running, samples may be left out without a new run.
        self._period_ns = SLOW_NS if self.values['lockstep'] else sys.maxsize
        self._held_ns: int | None = None
        self._publisher = self.advertise(GAMEPAD_JOY)
        self._message = GAMEPAD_JOY.message_class()
        self.listen(RUN, self._on_run)
        self.listen(PLANT_JOINT_STATES, self._on_truth, raw=True)

    def _on_run(self, header: Any) -> None:
        if self._run.announced(time_ns(header.stamp), header.frame_id) and self._held_ns:
            self._answer(self._held_ns)

    def _on_truth(self, truth: Any) -> None:
        now = stamp_of(truth)
        if now % SLOW_NS == 0:
            self._answer(now)

    def _answer(self, now_ns: int) -> None:
        elapsed = self._run.elapsed_ns(now_ns, self._period_ns)
        if elapsed is None:
            self._held_ns = now_ns
            return
        self._held_ns = None
        fill_sticks(self._message, now_ns, self._scenario.sticks_at(elapsed * 1e-9))
        self._publisher.publish(self._message)
        self.sampled(now_ns)


def main() -> None:
    """Run the node."""
    sys.exit(run_node(GamepadTeleop))


if __name__ == '__main__':
    main()
