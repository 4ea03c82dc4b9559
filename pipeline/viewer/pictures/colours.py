"""Colours that colour-blind readers distinguish, on dark and on light backgrounds.

Source: Okabe and Ito, "Color Universal Design" (2008), without its black and its yellow, which
vanish on a dark and on a light background.
"""

Colour = tuple[int, int, int]  # red, green, blue, 0..255

SKY_BLUE: Colour = (86, 180, 233)
ORANGE: Colour = (230, 159, 0)
BLUISH_GREEN: Colour = (0, 158, 115)
VERMILLION: Colour = (213, 94, 0)
REDDISH_PURPLE: Colour = (204, 121, 167)
BLUE: Colour = (0, 114, 178)
GREY: Colour = (120, 120, 120)
WHITE: Colour = (255, 255, 255)
BLACK: Colour = (0, 0, 0)

# One meaning per colour, in every view.
MEASURED = SKY_BLUE
MODEL = ORANGE
POSTERIOR = REDDISH_PURPLE
TRUTH = BLUISH_GREEN
FAULT = VERMILLION
NEUTRAL = GREY

# A label's ground in Rerun is half the theme's own grey and half what lies behind: on black it is
# 22 or 112 of 255, on which white has a contrast of 18.1 or 4.95. On the theme's own ground it is
# 28 or 239, on which no colour has 4.5 both times. All of the colours above are seen on black, too.
LABEL = WHITE
BACKGROUND = BLACK

# Levels of the tower, lowest first; repeated for further levels.
# Seven: as many as a run has nodes.
LEVELS = (SKY_BLUE, ORANGE, BLUISH_GREEN, REDDISH_PURPLE, VERMILLION, GREY, BLUE)
