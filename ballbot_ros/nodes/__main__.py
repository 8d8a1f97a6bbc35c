"""``python -m ballbot_ros.nodes NODE`` works like ``ros2 run ballbot_ros NODE``."""

from ballbot_ros.nodes.executables import main

if __name__ == '__main__':
    main()
