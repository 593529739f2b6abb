"""An approved response to compare with: recorded once, reviewed as text, checked at every change."""
