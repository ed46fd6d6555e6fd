"""Models by name: cards, verified files, and encoders ready for use.

- `hub.cards`: what the zoo says of each model; needs no torch
- `hub.store`: where files of weights lie, and how they get there; verified on every load
- `hub.header`, `hub.files`: the one-file checkpoint
- `hub.parts`, `hub.clip_readings`, `hub.model`: a loaded model
- `hub.loading`: `tactileforge.load`
"""

from tactileforge.util import lazy

__getattr__, __dir__, __all__ = lazy.attach(__name__)
