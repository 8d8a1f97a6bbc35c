"""Physics of the ballbot: equations of motion, actuator, battery, integration. No ROS."""
