"""`swath migrate`: files of an older version in the form of this one."""
