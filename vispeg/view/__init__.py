"""The local web page: open a log, see where the model fails, click an effect, watch the error fall."""
