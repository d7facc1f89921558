"""The output of a whole evaluation: data set statistics, figure 3 in both counts, and a page over all of it."""
