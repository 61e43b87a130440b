"""Commands that judge policies: evaluate, gap, suite, sensitivity, exploit, perturb."""
