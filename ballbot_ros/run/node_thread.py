"""A node on a separate thread in the process of a command."""

from __future__ import annotations

from threading import Thread

import rclpy

from ballbot_ros.nodes.base import AnyNode, spin
from ballbot_ros.nodes.processes import join_thread

END_S = 1.0
"""Time for a callback to return [s]; Python may abort if the thread still runs at its end."""


class NodeThread:
    """Runs a node's callbacks until it is closed; `error` says why the thread ended early."""

    def __init__(self, node: AnyNode) -> None:
        self._node = node
        self.error: BaseException | None = None
        self._end = rclpy.Future()
        self._thread = Thread(target=self._spin, name=node.get_name(), daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            spin([self._node], self._end)
        except BaseException as error:
            self.error = error
            self._node.finish()

    def close(self) -> None:
        """End the node."""
        self._end.set_result(None)
        join_thread(self._thread, END_S)
        self._node.close()
        self._node.destroy_node()
