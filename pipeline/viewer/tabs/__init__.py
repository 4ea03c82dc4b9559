"""One module a tab: its views, and how they lie on a wide and on a narrow screen."""
