#!/usr/bin/env bash
# A real Slurm on this machine alone, to try the workflow on: two nodes of one core each, no accounting, no systemd, no cgroups.
#   apt-get install slurmctld slurmd slurm-client munge
#   benchmarks/slurm/start.sh DIR      # for its files; stop it with benchmarks/slurm/stop.sh
# It writes /etc/slurm/slurm.conf, where jobs look for it: use a machine or a container that has no other Slurm.
set -euo pipefail

dir=$(mkdir -p "${1:?usage: start.sh DIR}" && cd "$1" && pwd)
[ "$(id -u)" = 0 ] || { echo "start.sh: Slurm's daemons start as root here: run it as root" >&2; exit 1; }
for daemon in munged slurmctld slurmd; do
  command -v "$daemon" > /dev/null || { echo "start.sh: $daemon is missing: install munge, slurmctld and slurmd" >&2; exit 1; }
done
host=$(hostname -s)
mkdir -p "$dir"/{state,spool,log} /run/munge
chown munge: /run/munge
chown slurm: "$dir"/{state,log}
mkdir -p /etc/slurm
cat > /etc/slurm/slurm.conf <<CONF
ClusterName=alone
SlurmctldHost=$host(127.0.0.1)
AuthType=auth/munge
SlurmUser=slurm
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
ReturnToService=2
JobRequeue=1
SlurmdTimeout=20
SlurmctldPort=16817
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool/%n
SlurmctldLogFile=$dir/log/slurmctld.log
SlurmdLogFile=$dir/log/slurmd-%n.log
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd-%n.pid
NodeName=node1 NodeHostname=$host NodeAddr=127.0.0.1 Port=16818 CPUs=1 RealMemory=8000
NodeName=node2 NodeHostname=$host NodeAddr=127.0.0.1 Port=16819 CPUs=1 RealMemory=8000
PartitionName=all Nodes=node1,node2 Default=YES MaxTime=INFINITE State=UP
CONF
pgrep -x munged > /dev/null || runuser -u munge -- munged
pgrep -x slurmctld > /dev/null || slurmctld -c
for node in node1 node2; do
  pgrep -f "slurmd -N $node" > /dev/null || slurmd -N "$node"
done
for _ in $(seq 30); do
  [ "$(sinfo -h -o %D -t idle 2> /dev/null)" = 2 ] && { sinfo; exit 0; }
  sleep 1
done
echo "start.sh: the nodes are not idle after 30 s: see $dir/log" >&2
exit 1
