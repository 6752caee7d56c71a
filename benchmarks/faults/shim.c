/* Makes the N-th call of a kind fail, in every process into which it is preloaded.

   The file named by SPALLWATCH_FAULTS is mapped by all of them. It names the roles (words of a command line) and the
   places (parts of a path), counts the calls of each kind by role and place, and holds one plan: which calls fail, how,
   from which on and for how many. A call that fails is noted with its process and path. Kinds stand in the order of
   KINDS in shim.py, and so do the members of the structure. Calls that the C library makes of itself are not seen. */

#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <spawn.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum kind {
    OPEN, READ, PREAD, WRITE, PWRITE, FSYNC, FDATASYNC, RENAME, UNLINK, FTRUNCATE, MMAP, LOCK, OPENDIR,
    SOCKET, BIND, LISTEN, ACCEPT, RECV, SEND, CONNECT, EPOLL_WAIT, POLL, MALLOC, THREAD, FORK, KINDS
};

enum { ROLES = 8, PLACES = 8, WORD = 64, LENGTH = 200, ANY = -1, SHORT = -1 };

struct control {
    uint32_t armed;
    int32_t kind, role, place, error, pid;
    int64_t first, last, seen, fired;
    char path[LENGTH];
    char roles[ROLES][WORD], places[PLACES][WORD];
    int64_t calls[KINDS][ROLES][PLACES];
};

static struct control *control;
static int own_role = ROLES - 1;

__attribute__((constructor)) static void begin(void)
{
    const char *name = getenv("SPALLWATCH_FAULTS");
    char line[8192];
    if (!name)
        return;
    int file = (int)syscall(SYS_openat, AT_FDCWD, "/proc/self/cmdline", O_RDONLY | O_CLOEXEC);
    long length = file < 0 ? 0 : syscall(SYS_read, file, line, sizeof line - 1);
    syscall(SYS_close, file);
    for (long i = 0; i < length; i++)
        if (!line[i])
            line[i] = ' ';
    line[length > 0 ? length : 0] = 0;
    file = (int)syscall(SYS_openat, AT_FDCWD, name, O_RDWR | O_CLOEXEC);
    if (file < 0)
        return;
    void *found = (void *)syscall(SYS_mmap, NULL, sizeof *control, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    syscall(SYS_close, file);
    if (found == MAP_FAILED)
        return;
    struct control *mapped = found;
    for (int i = 0; i < ROLES; i++)
        if (mapped->roles[i][0] && strstr(line, mapped->roles[i])) {
            own_role = i;
            break;
        }
    control = mapped;
}

/* Whether a call fails: 0, an error number, or SHORT. The last place is that of calls without a path. */
static int fails(enum kind kind, int descriptor, const char *path)
{
    struct control *c = control;
    char target[LENGTH] = "", link[40];
    int place = PLACES - 1, before = errno;
    if (!c)
        return 0;
    if (!path && descriptor >= 0) {
        snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
        long length = syscall(SYS_readlinkat, AT_FDCWD, link, target, sizeof target - 1);
        target[length > 0 ? length : 0] = 0;
        path = target;
        errno = before;
    }
    for (int i = 0; path && i < PLACES; i++)
        if (c->places[i][0] && strstr(path, c->places[i])) {
            place = i;
            break;
        }
    __atomic_add_fetch(&c->calls[kind][own_role][place], 1, __ATOMIC_RELAXED);
    if (!__atomic_load_n(&c->armed, __ATOMIC_ACQUIRE) || c->kind != (int)kind)
        return 0;
    if ((c->role != ANY && c->role != own_role) || (c->place != ANY && c->place != place))
        return 0;
    int64_t number = __atomic_add_fetch(&c->seen, 1, __ATOMIC_RELAXED);
    if (number < c->first || number > c->last)
        return 0;
    if (__atomic_add_fetch(&c->fired, 1, __ATOMIC_RELAXED) == 1) {
        c->pid = (int32_t)getpid();
        snprintf(c->path, sizeof c->path, "%s", path ? path : "");
    }
    return c->error;
}

#define REAL(result, name, ...)                                                                                        \
    static result (*real)(__VA_ARGS__);                                                                                \
    if (!real)                                                                                                         \
        real = (result(*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name)
#define FAIL_IF(kind, descriptor, path, result)                                                                        \
    do {                                                                                                               \
        int code = fails(kind, descriptor, path);                                                                      \
        if (code > 0) {                                                                                                \
            errno = code;                                                                                              \
            return result;                                                                                             \
        }                                                                                                              \
    } while (0)
#define SHORTEN(kind, descriptor, size)                                                                                \
    do {                                                                                                               \
        int code = fails(kind, descriptor, NULL);                                                                      \
        if (code > 0) {                                                                                                \
            errno = code;                                                                                              \
            return -1;                                                                                                 \
        }                                                                                                              \
        if (code == SHORT)                                                                                             \
            size = size / 2;                                                                                           \
    } while (0)
#define MODE(flags)                                                                                                    \
    mode_t mode = 0;                                                                                                   \
    if ((flags) & (O_CREAT | O_TMPFILE)) {                                                                             \
        va_list list;                                                                                                  \
        va_start(list, flags);                                                                                         \
        mode = va_arg(list, mode_t);                                                                                   \
        va_end(list);                                                                                                  \
    }

#define DEFINE_OPEN(name)                                                                                              \
    int name(const char *path, int flags, ...)                                                                         \
    {                                                                                                                  \
        MODE(flags)                                                                                                    \
        REAL(int, name, const char *, int, ...);                                                                       \
        FAIL_IF(OPEN, -1, path, -1);                                                                                   \
        return real(path, flags, mode);                                                                                \
    }
DEFINE_OPEN(open)
DEFINE_OPEN(open64)

#define DEFINE_OPENAT(name)                                                                                            \
    int name(int folder, const char *path, int flags, ...)                                                             \
    {                                                                                                                  \
        MODE(flags)                                                                                                    \
        REAL(int, name, int, const char *, int, ...);                                                                  \
        FAIL_IF(OPEN, -1, path, -1);                                                                                   \
        return real(folder, path, flags, mode);                                                                        \
    }
DEFINE_OPENAT(openat)
DEFINE_OPENAT(openat64)

ssize_t read(int file, void *data, size_t size)
{
    REAL(ssize_t, read, int, void *, size_t);
    SHORTEN(READ, file, size);
    return real(file, data, size);
}

ssize_t write(int file, const void *data, size_t size)
{
    REAL(ssize_t, write, int, const void *, size_t);
    SHORTEN(WRITE, file, size);
    return real(file, data, size);
}

ssize_t writev(int file, const struct iovec *parts, int count)
{
    REAL(ssize_t, writev, int, const struct iovec *, int);
    FAIL_IF(WRITE, file, NULL, -1);
    return real(file, parts, count);
}

#define DEFINE_PREAD(name, type)                                                                                       \
    ssize_t name(int file, void *data, size_t size, type offset)                                                       \
    {                                                                                                                  \
        REAL(ssize_t, name, int, void *, size_t, type);                                                                \
        SHORTEN(PREAD, file, size);                                                                                    \
        return real(file, data, size, offset);                                                                         \
    }
DEFINE_PREAD(pread, off_t)
DEFINE_PREAD(pread64, off64_t)

#define DEFINE_PWRITE(name, type)                                                                                      \
    ssize_t name(int file, const void *data, size_t size, type offset)                                                 \
    {                                                                                                                  \
        REAL(ssize_t, name, int, const void *, size_t, type);                                                          \
        SHORTEN(PWRITE, file, size);                                                                                   \
        return real(file, data, size, offset);                                                                         \
    }
DEFINE_PWRITE(pwrite, off_t)
DEFINE_PWRITE(pwrite64, off64_t)

int fsync(int file)
{
    REAL(int, fsync, int);
    FAIL_IF(FSYNC, file, NULL, -1);
    return real(file);
}

int fdatasync(int file)
{
    REAL(int, fdatasync, int);
    FAIL_IF(FDATASYNC, file, NULL, -1);
    return real(file);
}

int rename(const char *from, const char *to)
{
    REAL(int, rename, const char *, const char *);
    FAIL_IF(RENAME, -1, to, -1);
    return real(from, to);
}

int renameat(int from_folder, const char *from, int to_folder, const char *to)
{
    REAL(int, renameat, int, const char *, int, const char *);
    FAIL_IF(RENAME, -1, to, -1);
    return real(from_folder, from, to_folder, to);
}

int unlink(const char *path)
{
    REAL(int, unlink, const char *);
    FAIL_IF(UNLINK, -1, path, -1);
    return real(path);
}

int unlinkat(int folder, const char *path, int flags)
{
    REAL(int, unlinkat, int, const char *, int);
    FAIL_IF(UNLINK, -1, path, -1);
    return real(folder, path, flags);
}

#define DEFINE_FTRUNCATE(name, type)                                                                                   \
    int name(int file, type size)                                                                                      \
    {                                                                                                                  \
        REAL(int, name, int, type);                                                                                    \
        FAIL_IF(FTRUNCATE, file, NULL, -1);                                                                            \
        return real(file, size);                                                                                       \
    }
DEFINE_FTRUNCATE(ftruncate, off_t)
DEFINE_FTRUNCATE(ftruncate64, off64_t)

#define DEFINE_MMAP(name, type)                                                                                        \
    void *name(void *address, size_t size, int access, int flags, int file, type offset)                               \
    {                                                                                                                  \
        REAL(void *, name, void *, size_t, int, int, int, type);                                                       \
        FAIL_IF(MMAP, file, NULL, MAP_FAILED);                                                                         \
        return real(address, size, access, flags, file, offset);                                                       \
    }
DEFINE_MMAP(mmap, off_t)
DEFINE_MMAP(mmap64, off64_t)

#define DEFINE_FCNTL(name)                                                                                             \
    int name(int file, int command, ...)                                                                               \
    {                                                                                                                  \
        va_list list;                                                                                                  \
        va_start(list, command);                                                                                       \
        void *argument = va_arg(list, void *);                                                                         \
        va_end(list);                                                                                                  \
        REAL(int, name, int, int, ...);                                                                                \
        if (command == F_SETLK || command == F_SETLKW || command == F_OFD_SETLK || command == F_OFD_SETLKW)            \
            FAIL_IF(LOCK, file, NULL, -1);                                                                             \
        return real(file, command, argument);                                                                          \
    }
DEFINE_FCNTL(fcntl)
DEFINE_FCNTL(fcntl64)

int flock(int file, int operation)
{
    REAL(int, flock, int, int);
    FAIL_IF(LOCK, file, NULL, -1);
    return real(file, operation);
}

DIR *opendir(const char *path)
{
    REAL(DIR *, opendir, const char *);
    FAIL_IF(OPENDIR, -1, path, NULL);
    return real(path);
}

DIR *fdopendir(int file)
{
    REAL(DIR *, fdopendir, int);
    FAIL_IF(OPENDIR, file, NULL, NULL);
    return real(file);
}

int socket(int family, int type, int protocol)
{
    REAL(int, socket, int, int, int);
    FAIL_IF(SOCKET, -1, NULL, -1);
    return real(family, type, protocol);
}

int socketpair(int family, int type, int protocol, int pair[2])
{
    REAL(int, socketpair, int, int, int, int *);
    FAIL_IF(SOCKET, -1, NULL, -1);
    return real(family, type, protocol, pair);
}

int bind(int file, const struct sockaddr *address, socklen_t length)
{
    REAL(int, bind, int, const struct sockaddr *, socklen_t);
    FAIL_IF(BIND, file, NULL, -1);
    return real(file, address, length);
}

int listen(int file, int backlog)
{
    REAL(int, listen, int, int);
    FAIL_IF(LISTEN, file, NULL, -1);
    return real(file, backlog);
}

int accept(int file, struct sockaddr *address, socklen_t *length)
{
    REAL(int, accept, int, struct sockaddr *, socklen_t *);
    FAIL_IF(ACCEPT, file, NULL, -1);
    return real(file, address, length);
}

int accept4(int file, struct sockaddr *address, socklen_t *length, int flags)
{
    REAL(int, accept4, int, struct sockaddr *, socklen_t *, int);
    FAIL_IF(ACCEPT, file, NULL, -1);
    return real(file, address, length, flags);
}

int connect(int file, const struct sockaddr *address, socklen_t length)
{
    REAL(int, connect, int, const struct sockaddr *, socklen_t);
    FAIL_IF(CONNECT, file, NULL, -1);
    return real(file, address, length);
}

ssize_t recv(int file, void *data, size_t size, int flags)
{
    REAL(ssize_t, recv, int, void *, size_t, int);
    SHORTEN(RECV, file, size);
    return real(file, data, size, flags);
}

ssize_t recvfrom(int file, void *data, size_t size, int flags, struct sockaddr *from, socklen_t *length)
{
    REAL(ssize_t, recvfrom, int, void *, size_t, int, struct sockaddr *, socklen_t *);
    SHORTEN(RECV, file, size);
    return real(file, data, size, flags, from, length);
}

ssize_t send(int file, const void *data, size_t size, int flags)
{
    REAL(ssize_t, send, int, const void *, size_t, int);
    SHORTEN(SEND, file, size);
    return real(file, data, size, flags);
}

ssize_t sendto(int file, const void *data, size_t size, int flags, const struct sockaddr *to, socklen_t length)
{
    REAL(ssize_t, sendto, int, const void *, size_t, int, const struct sockaddr *, socklen_t);
    SHORTEN(SEND, file, size);
    return real(file, data, size, flags, to, length);
}

ssize_t sendmsg(int file, const struct msghdr *message, int flags)
{
    REAL(ssize_t, sendmsg, int, const struct msghdr *, int);
    FAIL_IF(SEND, file, NULL, -1);
    return real(file, message, flags);
}

int epoll_wait(int file, struct epoll_event *events, int most, int timeout)
{
    REAL(int, epoll_wait, int, struct epoll_event *, int, int);
    FAIL_IF(EPOLL_WAIT, file, NULL, -1);
    return real(file, events, most, timeout);
}

int poll(struct pollfd *files, nfds_t count, int timeout)
{
    REAL(int, poll, struct pollfd *, nfds_t, int);
    FAIL_IF(POLL, -1, NULL, -1);
    return real(files, count, timeout);
}

/* dlsym may allocate, so these call the C library by its inner names. */
void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *data, size_t size);

void *malloc(size_t size)
{
    FAIL_IF(MALLOC, -1, NULL, NULL);
    return __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    FAIL_IF(MALLOC, -1, NULL, NULL);
    return __libc_calloc(count, size);
}

void *realloc(void *data, size_t size)
{
    FAIL_IF(MALLOC, -1, NULL, NULL);
    return __libc_realloc(data, size);
}

int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*function)(void *), void *argument)
{
    REAL(int, pthread_create, pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
    int code = fails(THREAD, -1, NULL);
    return code > 0 ? code : real(thread, attributes, function, argument);
}

pid_t fork(void)
{
    REAL(pid_t, fork, void);
    FAIL_IF(FORK, -1, NULL, -1);
    return real();
}

/* The frame of a wrapper must not be left twice; a fork is what POSIX allows in its place. */
pid_t vfork(void)
{
    return fork();
}

int posix_spawn(pid_t *pid, const char *path, const posix_spawn_file_actions_t *actions,
                const posix_spawnattr_t *attributes, char *const words[], char *const environment[])
{
    REAL(int, posix_spawn, pid_t *, const char *, const posix_spawn_file_actions_t *, const posix_spawnattr_t *,
         char *const *, char *const *);
    int code = fails(FORK, -1, NULL);
    return code > 0 ? code : real(pid, path, actions, attributes, words, environment);
}
