"""What a placement is worth: regions, tables and reports."""
