"""Stage freed: things that were placed before take part in the drop as free bodies."""
