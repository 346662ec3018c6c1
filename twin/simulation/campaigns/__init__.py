"""Campaigns: many sessions of a machine and its model with faults, drawn at random, and what a trainee does about them.

- one session: `packet_hand` is the hand that moves the tool, `traced_run` a machine that follows it,
  `attacked_session` the comparison of machine and model, `hazard_trainee` the person who reacts, and
  `unbraked_deviation` how far the machine gets in spite of the reaction;
- many sessions: `campaign_table` is the file, `campaign` draws sessions from it, `campaign_log` stores their outcomes;
- results: `summary` is the result by class of faults, `roc` and `adaptive_limit` say how well faults are detected;
- `trends` runs the two experiments that the paper published, as `trends_table` describes them, for `trends_result`.

`twin.api.hazards` runs a campaign in several processes.
"""
