"""URLs without passwords: whatever their form, what is left is the same place."""

from __future__ import annotations

from urllib.parse import urlsplit

import pytest
from hypothesis import given
from hypothesis import strategies as st

from furrowmap.core.runtime.urls import without_passwords

SECRET = "S3cr3t"
WORD = st.text("abcXYZ019-_.~%", min_size=1, max_size=8)
PATH = st.lists(st.text("abc09@:-_.=", min_size=1, max_size=6).map("/{}".format), max_size=3).map("".join)
SCHEMES = ["sftp", "ssh", "ftp", "https", "s3", "postgresql", "tls", "simplecache::sftp", "webdav+http"]


@given(
    scheme=st.sampled_from(SCHEMES),
    user=st.one_of(st.just(""), WORD),
    password=st.text("abcXYZ019-_.~%!$&'()*+,;=:@", max_size=8),
    host=st.sampled_from(["host", "data.example.org", "10.0.0.1", "[2001:db8::1]", "bucket"]),
    port=st.sampled_from(["", ":22", ":8786"]),
    path=PATH,
    around=st.sampled_from(["{}", "cannot open '{}'", "({})", "a, {}, b"]),
)
def test_password__is_in_no_url(
    scheme: str, user: str, password: str, host: str, port: str, path: str, around: str
) -> None:
    shown = without_passwords(around.format(f"{scheme}://{user}:{SECRET}{password}@{host}{port}{path}"))
    at = f"{user}@"
    assert shown == around.format(f"{scheme}://{at}{host}{port}{path}")
    assert SECRET not in shown
    assert without_passwords(shown) == shown


@given(scheme=st.sampled_from(["sftp", "s3", "tcp", "https"]), user=st.one_of(st.just(""), WORD.map("{}@".format)),
       port=st.sampled_from(["", ":22", ":8786"]), path=PATH)  # fmt: skip
def test_url__without_a_password_stays(scheme: str, user: str, port: str, path: str) -> None:
    url = f"{scheme}://{user}host{port}{path}"
    assert without_passwords(url) == url
    assert urlsplit(url).password is None


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        ("https://h/a.las?token=S3cr3t&x=1", "https://h/a.las?token=&x=1"),
        ("abfs://c@account/x?sv=1&sig=S3cr3t", "abfs://c@account/x?sv=1&sig="),
        ("s3://b/k?X-Amz-Signature=S3cr3t", "s3://b/k?X-Amz-Signature="),
        ("postgresql://h/db?user=me&password=S3cr3t", "postgresql://h/db?user=me&password="),
        ("C:/field:1/me@home", "C:/field:1/me@home"),
        ("C:/a:b/me@home", "C:/a:b/me@home"),
        ("sftp:/me:S3cr3t@h/x does not exist.", "sftp:/me@h/x does not exist."),
        ("圃場/north", "圃場/north"),
    ],
)
def test_parameters__that_are_secret_are_empty(url: str, shown: str) -> None:
    assert without_passwords(url) == shown
