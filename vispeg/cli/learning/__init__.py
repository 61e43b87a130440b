"""Commands about policies and the worlds that they are trained in: train, finetune, combine, play, export."""
