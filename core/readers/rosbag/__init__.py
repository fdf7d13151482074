"""Bags of ROS 1 and ROS 2: their containers, whole or damaged, and the messages that furrowmap has a use for."""
