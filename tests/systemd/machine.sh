#!/bin/sh
# A machine for one test: a root of its own in memory, with the host's libraries, and systemd as its first process. Runs
# inside new pid, mount, cgroup, uts, ipc and net namespaces.
#   machine.sh FOLDER REPOSITORY PROGRAM...
set -eu
root=$1
repository=$2
shift 2

mount --make-rprivate /
mount -t tmpfs -o mode=0755 machine "$root"
cd "$root"
mkdir -p usr/bin usr/lib usr/lib64 etc/systemd/system etc/systemd/user etc/teleop run tmp proc sys dev var root old
chmod 1777 tmp
for link in bin sbin lib lib64; do
    case $link in sbin) to=bin ;; *) to=$link ;; esac
    ln -s "usr/$to" "$link"
done
ln -s bin usr/sbin
for folder in usr/lib usr/lib64; do
    mount --rbind "/$folder" "$folder"
    mount -o remount,bind,ro "$folder"
done
for program in "$@" /usr/bin/systemctl /usr/bin/umount; do
    : > "usr/bin/${program##*/}"
    mount --bind "$program" "usr/bin/${program##*/}"
done

cp /etc/ld.so.cache etc/ 2>/dev/null || true
cat > etc/passwd <<'END'
root:x:0:0::/root:/bin/sh
teleop:x:990:990::/:/sbin/nologin
operator:x:1000:1000::/tmp:/sbin/nologin
tracker:x:1001:1001::/tmp:/sbin/nologin
nobody:x:65534:65534::/:/sbin/nologin
END
cat > etc/group <<'END'
root:x:0:
teleop:x:990:
teleop-operator:x:991:
teleop-skeleton:x:992:
operator:x:1000:
tracker:x:1001:
nogroup:x:65534:
END
: > etc/fstab
echo 00000000000000000000000000000001 > etc/machine-id

cp -r "$repository/config/teleop.toml" "$repository/config/robots" etc/teleop/
cp -r "$repository/weights" etc/weights
# The simulated robot may do without real-time scheduling, which this machine may lack.
sed -i 's/^engage_without_realtime = false/engage_without_realtime = true/' etc/teleop/teleop.toml
# A user who is in no such group has settings of his own.
cp etc/teleop/teleop.toml etc/teleop/user.toml
mkdir -p tmp/.config/teleop
echo TELEOP_CONFIG=/etc/teleop/user.toml > tmp/.config/teleop/environment
chmod -R a+rX tmp/.config
# Trackers have a group of their own, as examples/client.conf says.
sed -i 's/^skeleton_group = ""/skeleton_group = "teleop-skeleton"/' etc/teleop/teleop.toml

# As little as systemd needs to come up, then the units under test, unchanged.
for unit in basic sysinit shutdown; do
    cp "/usr/lib/systemd/system/$unit.target" etc/systemd/system/
    printf '[Unit]\nDescription=%s\n' "$unit" > "etc/systemd/user/$unit.target"
done
cp -r "$repository"/config/systemd/system/* etc/systemd/system/
cp -r "$repository"/config/systemd/user/* etc/systemd/user/
cat > etc/systemd/system/client.service <<'END'
[Service]
User=tracker
Environment=TELEOP_TEST_CLIENT=/run/teleop
ExecStart=/usr/bin/client --exact systemd::client_publishes_until_stopped --ignored --nocapture
END
mkdir etc/systemd/system/client.service.d
cp "$repository/config/systemd/examples/client.conf" etc/systemd/system/client.service.d/teleop.conf
cat > etc/systemd/system/user-manager.service <<'END'
[Service]
Type=notify
User=operator
Delegate=yes
RuntimeDirectory=user/1000
RuntimeDirectoryMode=0700
Environment=XDG_RUNTIME_DIR=/run/user/1000 HOME=/tmp SYSTEMD_UNIT_PATH=/etc/systemd/user
ExecStart=/usr/lib/systemd/systemd --user --unit=basic.target
END
# Without a journal, what the services say goes to a file.
for unit in teleop@ client; do
    mkdir -p "etc/systemd/system/$unit.service.d"
    printf '[Service]\nStandardOutput=append:/tmp/log\nStandardError=append:/tmp/log\n' \
        > "etc/systemd/system/$unit.service.d/log.conf"
done

mount -t proc proc proc
mount -t sysfs -o ro sysfs sys
mountpoint -q sys/fs/cgroup || mount -t tmpfs cgroup sys/fs/cgroup
mount -t cgroup2 cgroup2 sys/fs/cgroup
mount -t tmpfs -o mode=0755 dev dev
for device in null zero full random urandom tty; do
    : > "dev/$device"
    mount --bind "/dev/$device" "dev/$device"
done
mkdir dev/shm
mount -t tmpfs -o mode=1777 shm dev/shm
mount -t tmpfs -o mode=0755 run run

pivot_root . old
umount -l /old
container=test SYSTEMD_UNIT_PATH=/etc/systemd/system \
    exec /usr/lib/systemd/systemd --system --unit=basic.target --log-target=console --show-status=no
