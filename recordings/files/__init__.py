"""Data files as columns, one reader per format; ``open_data_file`` picks it by the file's name."""

from jointscope.recordings.files.columns import Column, DataFile
from jointscope.recordings.files.opening import SUFFIXES, open_data_file

__all__ = ["SUFFIXES", "Column", "DataFile", "open_data_file"]
