"""Stage 9, render: pictures of the result."""
