"""Where numbers go bad: hard cases, the truth of each in 50 digits, and the judge of anybody's rays."""
