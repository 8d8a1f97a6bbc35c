"""The types of the messages that this package fills and reads, as rosbags declares them.

The classes of rclpy have the same fields, without types.
"""

from __future__ import annotations

from rosbags.typesys.stores import ros2_jazzy as jazzy

Time = jazzy.builtin_interfaces__msg__Time
Header = jazzy.std_msgs__msg__Header
Bytes = jazzy.std_msgs__msg__UInt8MultiArray
Twist = jazzy.geometry_msgs__msg__Twist
Vector3Stamped = jazzy.geometry_msgs__msg__Vector3Stamped
WrenchStamped = jazzy.geometry_msgs__msg__WrenchStamped
Imu = jazzy.sensor_msgs__msg__Imu
JointState = jazzy.sensor_msgs__msg__JointState
Joy = jazzy.sensor_msgs__msg__Joy
OccupancyGridMessage = jazzy.nav_msgs__msg__OccupancyGrid
Odometry = jazzy.nav_msgs__msg__Odometry
DiagnosticStatus = jazzy.diagnostic_msgs__msg__DiagnosticStatus
ParameterMessage = jazzy.rcl_interfaces__msg__Parameter
ParameterEvent = jazzy.rcl_interfaces__msg__ParameterEvent
