"""Samples in tars of other programs: members whose names start alike, as webdataset has them."""
