"""Scene folders of data sets: InteriorGS, ScanNet, SuGaR, COLMAP."""
