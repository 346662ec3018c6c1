"""Write a robot and its protocols for other programs: the export folder, its clips, and what several writers use.

    order                  all data of an export; order_of_robot: collect them from a robot
    clip                   a motion at keys; key_rate: of a planned motion, stage_clip: of a stage with a baked motion
    player_interpolation   what players show between keys, and its errors
    bundle                 write the export folder; proof_json, readme: its files proof.json and README.txt
    home_poses, model_hash the rest pose of every format, and the hash of the model that files show
    assumed_masses         masses where a format requires one and none is stated
    left_out               findings on data that a format cannot hold
    meshes, xml_text       mesh files and XML text of MJCF and URDF

The writers are the modules `write` in twin.exchange.formats.
"""
