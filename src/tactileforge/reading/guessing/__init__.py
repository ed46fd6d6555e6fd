"""Layouts of folders, guessed from names, headers, values and pixels.

- `guessing.layout`: the layouts of a folder, with lines to be checked
- `guessing.part`: the layout of files of one form, built from its guesses below
- `guessing.frames`, `guessing.background`, `guessing.rate`, `guessing.tiles`: pictures
- `guessing.tables`, `guessing.columns`, `guessing.families`, `guessing.force_headers`: tables
- `guessing.labels`, `guessing.numbers`: words and numbers beside pictures
- `guessing.media`, `guessing.patterns`, `guessing.view_words`, `guessing.sensor_names`: names
"""
