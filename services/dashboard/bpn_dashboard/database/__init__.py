"""The index over the run folders: engine, tables, and the schema's migrations."""
