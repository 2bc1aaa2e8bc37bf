"""Routes of poses from start to goal, clear of what a pose may not touch: what manoeuvres then follow.

`find_route` is the door; what makes a pose valid is put together in `pose_checks`, and only `rrt_connect` knows OMPL.
"""
