"""Contact classes: which features of the object may rest on which of the surroundings, and s(x).

`face`: a face on a level or sloping surface; `lean`: an edge or corners on a surface, and the body
against a wall. A class is all there is to know of it (`ContactClass`): nothing outside of this room
asks which one it is.
"""
