"""Statistics of scores and comparisons: means, ratings, win rates, agreement, and the uncertainty of each number."""
