"""Bags of ROS 1 and ROS 2, and MCAP files with topics of others."""
