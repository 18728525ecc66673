"""Fleets of ROS 2 over Zenoh: pictures, intrinsics and poses in, zones and maps out, all as CDR.

- `keys`       topics <-> key expressions, as rmw_zenoh and zenoh-bridge-ros2dds have them
- `topics`     which topics are whose camera, intrinsics and pose
- `poses`      poses of a camera from PoseStamped, Odometry or tf
- `own_origin` where on Earth those of one robot count from
- `intake`     pictures on their way into the service
- `publisher`  what the service tells the fleet
- `link`       both of them on one Zenoh session (extra `zenoh`)
"""
