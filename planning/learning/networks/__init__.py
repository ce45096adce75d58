"""OSNet and RPNet: tokens in, scores out; in torch for training, in numpy for planning."""
