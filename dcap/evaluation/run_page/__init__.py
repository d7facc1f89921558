"""What the page of a run shows: strips, tables, failures, costs and provenance, each made of the files of the run."""
