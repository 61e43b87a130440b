"""Effects of depth sensors: noise, bias, missing readings and errors of stereo matching."""
