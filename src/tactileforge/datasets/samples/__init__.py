"""Samples in tars of other programs, as webdataset has them: members that share the start of a name."""
