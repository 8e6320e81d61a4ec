"""The machine on the plant: under a policy, on stress trials, in scenarios, in the loop that diagnose closes, and on film."""
