"""From a tracked path to the values that plots show: the one place where tracking meets pbd.view's plots."""
