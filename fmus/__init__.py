"""C to FMI 2.0 and 3.0 co-simulation FMUs and the packages (.ssp) that wire them."""
