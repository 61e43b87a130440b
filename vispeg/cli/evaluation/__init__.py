"""Commands that judge policies: plan, evaluate, gap, suite, sensitivity, exploit, explain, perturb."""
