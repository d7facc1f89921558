"""`dcap study`: the pages that raters vote on, and the tables of their votes."""
