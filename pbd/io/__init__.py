"""Safe file access: only regular files of bounded size are read, and written files appear complete or not at all.

Each failure is a PbdError.
"""
