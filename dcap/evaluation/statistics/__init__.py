"""What follows from scores and comparisons: means, ratings, win rates, agreement, and how sure each number is."""
