"""The flight recorder: everything of a flight in one MCAP file with Foxglove schemas.

``recorder`` takes notes from the event loop and writes them in a thread of its own, ``messages``
and ``scene_messages`` say what is written, ``mcap_file`` how, ``reading`` gets it back, also from a
file whose writer was killed, and ``repair`` makes such a file whole. Nothing here knows a mission.
"""
