"""Public data sets as campaigns: one file per set, each writing only what the set's own documentation prints."""

from jointscope.recordings.importers.importer import IMPORTERS, Importer, import_data_set

__all__ = ["IMPORTERS", "Importer", "import_data_set"]
