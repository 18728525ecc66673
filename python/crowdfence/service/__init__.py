"""The live service: drones give views, everybody else gets zones (`crowdfence serve`).

    replay or live views -> mission (the frame loop) -> store, page, WebSocket, exports

- `settings`          what a service is told
- `mission`           the frame loop with what is published after each step
- `replay` `live`     where the instants come from
- `gate` `gathering`  which live views are taken, and how they become instants
- `detecting`         pictures on their way through the detector
- `poses`             poses of views that come without: `telemetry` by `mavlink_link`, or `ros/`
- `ros/`              fleets of ROS 2 over Zenoh: pictures and poses in, zones and maps out
- `view_message`      a view as JSON
- `store`             SQLite: journal, snapshots, history, audit
- `timeline` `media`  what was closed, what was believed and what was seen at earlier stamps
- `ground` `belief`   the terrain and the crowd map from above, as bytes
- `fleet` `zone_json` `zone_set_json`   what is told of drones and of zones; of those of others once
- `static_zones_held` the other end of that, for the Python client
- `operator_zones`    what operators closed, locked and opened
- `left_out`          drones whose looks do not count, because an operator says that they see nothing
- `alerts` `watch`    what somebody should look at, and what notices it
- `recent_looks`      what drones showed of late, and where their crowd went
- `access` `guard`    who may do what; limits, headers
- `stream` `routes/` `app` `server`  HTTP and WebSocket
- `client`            the same from Python
"""
