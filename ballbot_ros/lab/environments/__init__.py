"""The environments of :mod:`ballbot_ros.environments`, which registers them."""
