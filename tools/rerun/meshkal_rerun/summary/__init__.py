# SPDX-License-Identifier: MIT
from meshkal_log.fields import LINEAR, NAVIGATION, TRACKING

from .linear import Summary
from .navigation import NavigationSummary
from .tracking import TrackingSummary

SUMMARIES = {LINEAR: Summary, TRACKING: TrackingSummary, NAVIGATION: NavigationSummary}  # by the kind of the log
