"""Times of samples, by the device's clock or by their arrival; how many were lost."""
