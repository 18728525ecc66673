"""What a run found as ROS 2 messages, to be looked at beside its cameras (Foxglove, RViz) or planned with.

    /crowdfence/zones       visualization_msgs/MarkerArray  closed crowd and unseen ground, at every instant
    /crowdfence/zones_of_others  visualization_msgs/MarkerArray  what others closed, once
    /crowdfence/closed      nav_msgs/OccupancyGrid          both as cells, whenever it changed
    /crowdfence/belief      nav_msgs/OccupancyGrid          probability of crowd at the last instant
    /crowdfence/ground      sensor_msgs/PointCloud2         state and probability per ground cell, likewise
    /crowdfence/terrain     visualization_msgs/MarkerArray  the terrain as a mesh, once
    /tf_static              tf2_msgs/TFMessage              earth -> map, once, where the run has a place

All but the last are in the frame `map`: local east-north-up metres around the georeference. `earth` is the
Earth-centred frame of REP 105 (EPSG:4978).

- `zone_markers`  zones -> markers
- `grids`         the map and the zones -> occupancy grids
- `ground`        the map -> points, and the mesh of the terrain
- `earth_frame`   where the local frame lies on the Earth
- `topics`        all of a run's messages in the order of their stamps
"""

from crowdfence.exports.ros2.topics import result_messages, write_results_mcap

__all__ = ["result_messages", "write_results_mcap"]
