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
    """

    def __init__(self, plant: PlantSim) -> None:
        self._plant = plant
        for name, kind, callback in (
            ('reset', Trigger, self._reset),
            ('pause', SetBool, self._pause),
            ('step', Trigger, self._step),
        ):
            plant.create_service(kind, f'{PLANT}/{name}', callback)

    def _reset(self, request: Any, response: Any) -> Any:
        self._plant.tell(self._plant.master.reset)
        response.success = True
        response.message = 'a new run begins'
        return response

    def _pause(self, request: Any, response: Any) -> Any:
        self._plant.tell(self._plant.master.set_paused, is_paused=request.data)
        response.success = True
        response.message = 'paused' if request.data else 'running'
        return response

    def _step(self, request: Any, response: Any) -> Any:
        response.success = self._plant.master.pause.is_paused
        response.message = 'one tick' if response.success else 'pause the plant first'
        self._plant.tell(self._plant.master.step)
        return response
