"""Clips, contact, force and slip from a stream of frames, online.

- `streaming.buffer`: the newest clip, cut by time
- `streaming.contact`: contact from the background, slip from forces
- `streaming.inputs`: images, sensors and backgrounds, checked
- `streaming.touch_stream`: the stream of `Model.stream` and ``tactileforge live``
"""
