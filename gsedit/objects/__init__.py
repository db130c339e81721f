"""Operations on one object of a scene: select, remove and fill, move, copy, insert, grow, bend."""
