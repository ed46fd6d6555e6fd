"""Pictures of printed dots."""

import cv2
import numpy as np

SIZE = 120, 160


def places(rows=4, columns=6, pitch=24.0):
    x = (np.arange(columns) - (columns - 1) / 2) * pitch + (SIZE[1] - 1) / 2
    y = (np.arange(rows) - (rows - 1) / 2) * pitch + (SIZE[0] - 1) / 2
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def picture(at, radius=4.0, gel=150, ink=25, noise=0.0, seed=0):
    """Dots with smooth edges, drawn eight times finer."""
    fine = np.full((8 * SIZE[0], 8 * SIZE[1], 3), gel, np.uint8)
    for x, y in at:
        center = round(8 * (x + 0.5) - 0.5), round(8 * (y + 0.5) - 0.5)
        cv2.circle(fine, center, round(8 * radius), (ink, ink, ink), -1)
    small = cv2.resize(fine, SIZE[::-1], interpolation=cv2.INTER_AREA).astype(np.float32)
    small += noise * np.random.default_rng(seed).standard_normal(small.shape)
    return small.round().clip(0, 255).astype(np.uint8)
