"""The builders that recipes may name, for furniture and things to place, each under the name of its function."""

from dcap.synthetic.furniture import bath, beds, decor, seats, tables
from dcap.synthetic.schema import PieceChoice, choice_of
from dcap.synthetic.things import play, rigid, soft

FURNITURE = (
    beds.bed,
    seats.sofa,
    seats.chair,
    seats.office_chair,
    seats.stool,
    seats.ottoman,
    tables.table,
    tables.round_table,
    tables.desk,
    tables.cabinet,
    tables.bedside_table,
    tables.wardrobe,
    tables.bookshelf,
    bath.bathtub,
    bath.basin_cabinet,
    bath.toilet,
    bath.mirror,
    decor.floor_lamp,
    decor.table_lamp,
    decor.plant,
    decor.book_row,
    decor.book_stack,
    decor.rug,
    decor.round_rug,
    decor.picture,
    decor.television,
    decor.small_vase,
    decor.toy_crate,
    decor.cushion_on_slope,
)

THINGS = (
    play.toy_ball,
    play.basketball,
    play.soccer_ball,
    play.tennis_ball,
    play.dumbbell,
    play.toy_block,
    play.toy_car,
    rigid.mug,
    rigid.cup,
    rigid.bowl,
    rigid.plate,
    rigid.book,
    rigid.laptop,
    rigid.vase,
    rigid.apple,
    rigid.tray,
    rigid.bottle,
    rigid.remote,
    rigid.pencil,
    rigid.pole,
    rigid.candle,
    soft.pillow,
    soft.cushion,
    soft.plush_bear,
    soft.plush_rabbit,
    soft.folded_towel,
    soft.folded_blanket,
    soft.shoe,
)

PIECES = choice_of(PieceChoice, (*FURNITURE, *THINGS))
"""Builders of both kinds, for rooms and for objects: a mug may stand on a table, a sofa may be placed."""
