"""Samples in tars of other programs: members with a common stem, as in webdataset."""
