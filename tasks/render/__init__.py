"""Stage 9, render: pictures of what came out."""
