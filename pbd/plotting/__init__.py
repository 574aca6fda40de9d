"""From the tracker's stages to the values that plots show: the one place where tracking meets pbd.view's plots."""
