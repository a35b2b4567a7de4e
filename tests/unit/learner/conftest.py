"""One thread, as the learner computes; and no deadlines: how long an example takes proves nothing."""

import torch
from hypothesis import settings

torch.set_num_threads(1)
settings.register_profile("learner", deadline=None)
settings.load_profile("learner")
