"""MCAP logs: records, and messages in Protobuf, ROS 2 and JSON."""
