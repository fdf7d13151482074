"""Bags of ROS 1 and ROS 2: their storages, complete or damaged, and the messages that furrowmap reads."""
