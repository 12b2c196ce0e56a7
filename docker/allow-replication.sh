#!/bin/bash
# Lets the standby of compose.cluster.yaml copy and follow the primary; run once, when the primary's folder is made.
echo "host replication quadmeshd all scram-sha-256" >>"$PGDATA/pg_hba.conf"
