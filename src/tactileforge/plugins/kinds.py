"""Kinds of plugins, and their places in a configuration."""

KINDS = ("sensors", "datasets", "encoders", "heads", "objectives", "optimizers", "checks")
#: Kinds whose entry points name a module: verbs of the command line.
MODULES = ("verbs",)
#: Kinds without a conformance suite by name: publishers of ``live``, schedules of the learning rate
#: and runners of suites of ``bench`` (a function each), trackers of ``data pack``, callbacks and
#: loggers of Lightning, changes of batches on the device, readers of tables by the endings of their
#: files, packages of YAML options, and containers of data, checked on a file of theirs.
OTHERS = (
    *("containers", "publishers", "schedules", "curves", "runners", "importers", "trackers"),
    *("callbacks", "loggers", "augmentations", "tables", "conf"),
)

#: Kind of plugin behind the options of each group of a configuration.
GROUPS = {
    "sensor": "sensors",
    "force": "sensors",
    "camera": "sensors",
    "robot": "sensors",
    "data": "datasets",
    "encoder": "encoders",
    "head": "heads",
    "objective": "objectives",
    "text_encoder": "encoders",
    "image_encoder": "encoders",
    "optim": "optimizers",
    "callbacks": "callbacks",
    "logger": "loggers",
}
