/* Records every call that changes files below CRASH_ROOT, in one order for all threads and processes, to CRASH_RECORD.
 *
 * Preloaded (LD_PRELOAD). Each call is made and written down under one lock, so that the record has the order in which
 * the calls took effect. Memory maps are not seen: SQLite maps only the index of its log (-shm), which is made anew.
 * One entry is a struct head, the two paths, and the data. The record is complete if what it builds is what is there:
 * benchmarks/crash/history.py compares.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

struct head {
    uint64_t inode, offset, length;
    uint32_t first, second;
    char kind, is_folder, spare[6];
};

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static char root[PATH_MAX];
static size_t root_length;
static int out = -1;
static pid_t owner;

#define RAW_WRITEV(fd, parts, n) syscall(SYS_writev, fd, parts, n)

static void forked(void) { pthread_mutex_init(&mutex, NULL); out = -1; }

__attribute__((constructor)) static void start(void) {
    const char *found = getenv("CRASH_ROOT");
    if (found && *found && strlen(found) < sizeof root) {
        strcpy(root, found);
        root_length = strlen(root);
    }
    pthread_atfork(NULL, NULL, forked);
}

static int below(const char *path) {
    return root_length && !strncmp(path, root, root_length) && (path[root_length] == '/' || !path[root_length]);
}

/* A lock belongs to an open file, so that each process opens the record itself. */
static void lock(void) {
    pthread_mutex_lock(&mutex);
    if (out < 0 || owner != getpid()) {
        const char *name = getenv("CRASH_RECORD");
        out = name ? syscall(SYS_openat, AT_FDCWD, name, O_WRONLY | O_APPEND | O_CLOEXEC, 0) : -1;
        if (out < 0) abort();
        int high = fcntl(out, F_DUPFD_CLOEXEC, 900);
        if (high >= 0) { syscall(SYS_close, out); out = high; }
        owner = getpid();
    }
    while (flock(out, LOCK_EX) && errno == EINTR) {}
}

static void unlock(void) {
    int kept = errno;
    flock(out, LOCK_UN);
    pthread_mutex_unlock(&mutex);
    errno = kept;
}

static void note(char kind, int is_folder, uint64_t inode, uint64_t offset, const char *first, const char *second,
                 const void *data, uint64_t length) {
    int kept = errno;
    struct head head = {inode, offset, length, first ? strlen(first) : 0, second ? strlen(second) : 0,
                        kind, (char)is_folder, {0}};
    struct iovec parts[4] = {{&head, sizeof head}, {(void *)first, head.first}, {(void *)second, head.second},
                             {(void *)data, data ? length : 0}};
    size_t all = sizeof head + head.first + head.second + (data ? length : 0);
    if (RAW_WRITEV(out, parts, 4) != (ssize_t)all) abort();
    errno = kept;
}

/* Return the absolute path of a name, whose folder is resolved and whose last part is not. */
static const char *absolute(int folder, const char *name, char *buffer) {
    char joined[2 * PATH_MAX], link[64];
    int kept = errno;
    if (name[0] == '/') snprintf(joined, sizeof joined, "%s", name);
    else {
        char at[PATH_MAX] = "";
        if (folder == AT_FDCWD) { if (!getcwd(at, sizeof at)) at[0] = 0; }
        else {
            snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
            ssize_t n = readlink(link, at, sizeof at - 1);
            at[n > 0 ? n : 0] = 0;
        }
        snprintf(joined, sizeof joined, "%s/%s", at, name);
    }
    size_t n = strlen(joined);
    while (n > 1 && joined[n - 1] == '/') joined[--n] = 0;
    char *last = strrchr(joined, '/'), resolved[PATH_MAX];
    if (last && last != joined) {
        *last = 0;
        if (!realpath(joined, resolved)) snprintf(resolved, sizeof resolved, "%.4095s", joined);
        snprintf(buffer, PATH_MAX, "%.3000s/%.1000s", resolved, last + 1);
    } else snprintf(buffer, PATH_MAX, "%.4095s", joined);
    errno = kept;
    return below(buffer) ? buffer : NULL;
}

/* Return whether an open file is a file or folder below the root, with its status. */
static int watched(int fd, struct stat *found) {
    char link[64], path[PATH_MAX];
    int kept = errno;
    if (!root_length || fd == out) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, sizeof path - 1);
    path[n > 0 ? n : 0] = 0;
    int yes = n > 0 && below(path) && !fstat(fd, found) && (S_ISREG(found->st_mode) || S_ISDIR(found->st_mode));
    errno = kept;
    return yes;
}

static int opening(int folder, const char *name, int flags, mode_t mode) {
    char path[PATH_MAX];
    if (!root_length || !(flags & (O_CREAT | O_TRUNC)) || !absolute(folder, name, path))
        return syscall(SYS_openat, folder, name, flags, mode);
    struct stat before, after;
    lock();
    int existed = !lstat(path, &before);
    int fd = syscall(SYS_openat, folder, name, flags, mode);
    if (fd >= 0 && !fstat(fd, &after) && S_ISREG(after.st_mode)) {
        if (!existed) note('c', 0, after.st_ino, 0, path, NULL, NULL, 0);
        else if ((flags & O_TRUNC) && before.st_size) note('t', 0, after.st_ino, 0, path, NULL, NULL, 0);
    }
    unlock();
    return fd;
}

static mode_t mode_of(int flags, va_list list) {
    return flags & (O_CREAT | __O_TMPFILE) ? va_arg(list, mode_t) : 0;
}
#define OPEN(name) int name(const char *path, int flags, ...) { \
    va_list list; va_start(list, flags); mode_t mode = mode_of(flags, list); va_end(list); \
    return opening(AT_FDCWD, path, flags, mode); }
#define OPENAT(name) int name(int folder, const char *path, int flags, ...) { \
    va_list list; va_start(list, flags); mode_t mode = mode_of(flags, list); va_end(list); \
    return opening(folder, path, flags, mode); }
OPEN(open) OPEN(open64) OPENAT(openat) OPENAT(openat64)
int __open_2(const char *path, int flags) { return opening(AT_FDCWD, path, flags, 0); }
int __open64_2(const char *path, int flags) { return opening(AT_FDCWD, path, flags, 0); }
int creat(const char *path, mode_t mode) { return opening(AT_FDCWD, path, O_CREAT | O_WRONLY | O_TRUNC, mode); }
int creat64(const char *path, mode_t mode) { return creat(path, mode); }

static off_t place(int fd, const struct stat *found) {
    return fcntl(fd, F_GETFL) & O_APPEND ? found->st_size : lseek(fd, 0, SEEK_CUR);
}

static ssize_t writing(int fd, const struct iovec *parts, int n, off_t offset, int placed) {
    struct stat found;
    if (!watched(fd, &found)) return placed ? syscall(SYS_pwritev, fd, parts, n, offset, 0L) : RAW_WRITEV(fd, parts, n);
    lock();
    fstat(fd, &found);
    off_t at = placed ? offset : place(fd, &found);
    ssize_t done = placed ? syscall(SYS_pwritev, fd, parts, n, offset, 0L) : RAW_WRITEV(fd, parts, n);
    for (ssize_t left = done, k = 0; left > 0 && k < n; k++) {
        size_t here = (size_t)left < parts[k].iov_len ? (size_t)left : parts[k].iov_len;
        note('w', 0, found.st_ino, at, NULL, NULL, parts[k].iov_base, here);
        at += here;
        left -= here;
    }
    unlock();
    return done;
}
ssize_t write(int fd, const void *data, size_t length) {
    struct iovec part = {(void *)data, length};
    struct stat found;
    return watched(fd, &found) ? writing(fd, &part, 1, 0, 0) : syscall(SYS_write, fd, data, length);
}
ssize_t pwrite(int fd, const void *data, size_t length, off_t offset) {
    struct iovec part = {(void *)data, length};
    return writing(fd, &part, 1, offset, 1);
}
ssize_t pwrite64(int fd, const void *data, size_t length, off_t offset) { return pwrite(fd, data, length, offset); }
ssize_t writev(int fd, const struct iovec *parts, int n) { return writing(fd, parts, n, 0, 0); }
ssize_t pwritev(int fd, const struct iovec *parts, int n, off_t offset) { return writing(fd, parts, n, offset, 1); }
ssize_t pwritev64(int fd, const struct iovec *parts, int n, off_t offset) { return writing(fd, parts, n, offset, 1); }

/* Note what the kernel copied by itself. */
static void note_copied(int fd, uint64_t inode, off_t at, ssize_t done) {
    char link[64], *data = done > 0 ? malloc(done) : NULL;
    if (!data) return;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    int again = syscall(SYS_openat, AT_FDCWD, link, O_RDONLY | O_CLOEXEC, 0);
    if (again < 0 || pread(again, data, done, at) != done) abort();
    syscall(SYS_close, again);
    note('w', 0, inode, at, NULL, NULL, data, done);
    free(data);
}
ssize_t sendfile(int to, int from, off_t *offset, size_t length) {
    struct stat found;
    if (!watched(to, &found)) return syscall(SYS_sendfile, to, from, offset, length);
    lock();
    off_t at = place(to, &found);
    ssize_t done = syscall(SYS_sendfile, to, from, offset, length);
    note_copied(to, found.st_ino, at, done);
    unlock();
    return done;
}
ssize_t sendfile64(int to, int from, off64_t *offset, size_t length) { return sendfile(to, from, offset, length); }
ssize_t copy_file_range(int from, off64_t *start, int to, off64_t *offset, size_t length, unsigned flags) {
    struct stat found;
    if (watched(to, &found)) { errno = ENOSYS; return -1; }
    return syscall(SYS_copy_file_range, from, start, to, offset, length, flags);
}
int ftruncate(int fd, off_t size) {
    struct stat found;
    if (!watched(fd, &found)) return syscall(SYS_ftruncate, fd, size);
    lock();
    int done = syscall(SYS_ftruncate, fd, size);
    if (!done) note('t', 0, found.st_ino, size, NULL, NULL, NULL, 0);
    unlock();
    return done;
}
int ftruncate64(int fd, off64_t size) { return ftruncate(fd, size); }
int fallocate(int fd, int mode, off_t offset, off_t length) {
    struct stat found;
    if (watched(fd, &found)) { errno = EOPNOTSUPP; return -1; }
    return syscall(SYS_fallocate, fd, mode, offset, length);
}
int fallocate64(int fd, int mode, off64_t offset, off64_t length) { return fallocate(fd, mode, offset, length); }

static int syncing(long call, int fd) {
    struct stat found;
    if (!watched(fd, &found)) return syscall(call, fd);
    lock();
    int done = syscall(call, fd);
    if (!done) note(call == SYS_fsync ? 's' : 'd', S_ISDIR(found.st_mode), found.st_ino, 0, NULL, NULL, NULL, 0);
    unlock();
    return done;
}
int fsync(int fd) { return syncing(SYS_fsync, fd); }
int fdatasync(int fd) { return syncing(SYS_fdatasync, fd); }

static int moving(char kind, int f1, const char *name1, int f2, const char *name2, unsigned flags) {
    char a[PATH_MAX], b[PATH_MAX];
    const char *from = root_length ? absolute(f1, name1, a) : NULL, *to = root_length ? absolute(f2, name2, b) : NULL;
    long call = kind == 'r' ? SYS_renameat2 : SYS_linkat;
    if (!from && !to) return syscall(call, f1, name1, f2, name2, flags);
    struct stat found;
    lock();
    int known = !lstat(a, &found);
    int done = syscall(call, f1, name1, f2, name2, flags);
    if (!done && known) note(kind, S_ISDIR(found.st_mode), found.st_ino, 0, a, b, NULL, 0);
    unlock();
    return done;
}
int rename(const char *a, const char *b) { return moving('r', AT_FDCWD, a, AT_FDCWD, b, 0); }
int renameat(int f, const char *a, int g, const char *b) { return moving('r', f, a, g, b, 0); }
int renameat2(int f, const char *a, int g, const char *b, unsigned flags) { return moving('r', f, a, g, b, flags); }
int link(const char *a, const char *b) { return moving('l', AT_FDCWD, a, AT_FDCWD, b, 0); }
int linkat(int f, const char *a, int g, const char *b, int flags) { return moving('l', f, a, g, b, flags); }

static int removing(int folder, const char *name, int flags) {
    char path[PATH_MAX];
    if (!root_length || !absolute(folder, name, path)) return syscall(SYS_unlinkat, folder, name, flags);
    lock();
    int done = syscall(SYS_unlinkat, folder, name, flags);
    if (!done) note(flags & AT_REMOVEDIR ? 'x' : 'u', 0, 0, 0, path, NULL, NULL, 0);
    unlock();
    return done;
}
int unlink(const char *path) { return removing(AT_FDCWD, path, 0); }
int unlinkat(int folder, const char *path, int flags) { return removing(folder, path, flags); }
int rmdir(const char *path) { return removing(AT_FDCWD, path, AT_REMOVEDIR); }
int remove(const char *path) {
    struct stat found;
    return removing(AT_FDCWD, path, !lstat(path, &found) && S_ISDIR(found.st_mode) ? AT_REMOVEDIR : 0);
}

int mkdirat(int folder, const char *name, mode_t mode) {
    char path[PATH_MAX];
    struct stat found;
    if (!root_length || !absolute(folder, name, path)) return syscall(SYS_mkdirat, folder, name, mode);
    lock();
    int done = syscall(SYS_mkdirat, folder, name, mode);
    if (!done && !lstat(path, &found)) note('m', 1, found.st_ino, 0, path, NULL, NULL, 0);
    unlock();
    return done;
}
int mkdir(const char *path, mode_t mode) { return mkdirat(AT_FDCWD, path, mode); }

/* Note what the life says of itself: from here on it was told that this is durable. */
void crash_mark(const char *text) {
    if (!root_length) return;
    lock();
    note('!', 0, 0, 0, text, NULL, NULL, 0);
    unlock();
}
