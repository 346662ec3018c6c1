"""ROS 2 without ROS: programs of ROS systems reach `twin serve` by the protocol rosbridge."""
