"""Clips, contact, force and slip of a stream of frames, as they come.

- `streaming.buffer`: the newest clip, cut by time
- `streaming.contact`: contact from the background, slip from forces
- `streaming.inputs`: images, sensors and backgrounds, checked
- `streaming.touch_stream`: what `Model.stream` gives, and ``tactileforge live`` reads
"""
