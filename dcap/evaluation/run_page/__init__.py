"""Content of a run's page: strips, tables, failures, costs and provenance, each made from the files of the run."""
