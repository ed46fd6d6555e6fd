"""Light on a gel, and the depth of its surface from pictures.

- `depth.reader`: depth from pictures of a calibrated sensor
- `depth.lighting`, `depth.features`: pictures from surfaces, as calibrations; `depth.inverse`: back
- `depth.presses`, `depth.fit`: calibrations fitted on presses of a ball
- `depth.contact`, `depth.gel`, `depth.waves`: the gel around that ball
"""
