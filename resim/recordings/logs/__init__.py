"""Logs of messages and signals (MCAP, rosbag2, MDF4): a topic becomes a table, which a mapping explains."""
