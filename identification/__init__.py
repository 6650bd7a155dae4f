"""From a campaign to FRFs with covariance, and from those to parameters with intervals, or a refusal with its reason."""
