"""The local web page: open a log, see where the model fails, add an effect with a click, see the error fall."""
