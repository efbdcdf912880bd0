"""The console's outer wall: REST, the event stream, authentication, the 3D scene's bridge.

``web.make_web`` puts it together from routers that are made by functions. Everything is asked of
``server.mission.commands.MissionControl`` except the three stops, which go straight to
``server.stages.StopControl``.
"""
