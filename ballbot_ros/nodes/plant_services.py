"""The plant's services: reset, pause and single step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from std_srvs.srv import SetBool, Trigger

from ballbot_ros.parameters import PLANT

if TYPE_CHECKING:
    from ballbot_ros.nodes.plant_sim import PlantSim


class PlantServices:
    """Serves ``plant_sim/reset``, ``plant_sim/pause`` and ``plant_sim/step``.

    These names are the role's: they stay where the node is given another name.

    Attributes
    ----------
    paused : bool
        The plant keeps the duty of its tick and does not move on.
    """

    def __init__(self, plant: PlantSim) -> None:
        self._plant = plant
        self.paused = False
        self._steps = 0
        for name, kind, callback in (
            ('reset', Trigger, self._reset),
            ('pause', SetBool, self._pause),
            ('step', Trigger, self._step),
        ):
            plant.create_service(kind, f'{PLANT}/{name}', callback)

    def may_advance(self) -> bool:
        """Tell whether the plant may move on by one tick, and use up a step."""
        if not self.paused:
            return True
        if self._steps == 0:
            return False
        self._steps -= 1
        return True

    def _reset(self, request: Any, response: Any) -> Any:
        self._plant.reset()
        response.success = True
        response.message = 'a new run begins'
        return response

    def _pause(self, request: Any, response: Any) -> Any:
        if request.data != self.paused:
            self._plant.get_logger().info('paused' if request.data else 'goes on')
        self.paused = request.data
        response.success = True
        response.message = 'paused' if self.paused else 'running'
        if not self.paused:
            self._steps = 0
            self._plant.go_on()
        return response

    def _step(self, request: Any, response: Any) -> Any:
        response.success = self.paused
        response.message = 'one tick' if self.paused else 'pause the plant first'
        if self.paused:
            self._steps += 1
            self._plant.advance()
        return response
