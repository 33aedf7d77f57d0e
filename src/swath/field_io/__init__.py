"""Importers and exporters of fields: yield logs, ISOXML, rasters, field folders."""
