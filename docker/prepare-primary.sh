#!/bin/bash
# Prepares the primary of compose.cluster.yaml for its standby; run once, when its folder is made. That commits wait for the
# standby begins with the next start: the image makes the database first, when there is no standby yet, and would wait for ever.
echo "host replication quadmeshd all scram-sha-256" >>"$PGDATA/pg_hba.conf"
echo "synchronous_standby_names = 'ANY 1 (standby)'" >>"$PGDATA/postgresql.conf"
