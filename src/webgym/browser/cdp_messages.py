"""The parts of the DevTools protocol's messages that we read. Names and shapes are the protocol's."""

from __future__ import annotations

import msgspec


class Wire(msgspec.Struct, frozen=True, rename="camel"):
    """Base: camelCase on the wire, unknown fields ignored."""


class Nothing(Wire, frozen=True):
    """A reply that says only that it was done."""


class Version(Wire, frozen=True):
    """``Browser.getVersion``."""

    product: str


class BrowserContext(Wire, frozen=True):
    """``Target.createBrowserContext``."""

    browser_context_id: str


class CreatedTarget(Wire, frozen=True):
    """``Target.createTarget``."""

    target_id: str


class Attached(Wire, frozen=True):
    """``Target.attachToTarget``."""

    session_id: str


class TargetCrashed(Wire, frozen=True):
    """``Target.targetCrashed``."""

    target_id: str


class TargetInfo(Wire, frozen=True):
    """A page, worker or frame that can be attached to."""

    target_id: str
    type: str
    url: str = ""
    browser_context_id: str = ""
    opener_id: str = ""


class AttachedToTarget(Wire, frozen=True):
    """``Target.attachedToTarget``."""

    session_id: str
    target_info: TargetInfo
    waiting_for_debugger: bool = False


class DetachedFromTarget(Wire, frozen=True):
    """``Target.detachedFromTarget``."""

    session_id: str
    target_id: str = ""


class Frame(Wire, frozen=True):
    """A frame of the page."""

    id: str
    loader_id: str
    url: str
    parent_id: str | None = None
    url_fragment: str = ""
    unreachable_url: str = ""


class FrameAttached(Wire, frozen=True):
    """``Page.frameAttached``."""

    frame_id: str
    parent_frame_id: str = ""


class FrameNavigated(Wire, frozen=True):
    """``Page.frameNavigated``."""

    frame: Frame


class NavigatedWithinDocument(Wire, frozen=True):
    """``Page.navigatedWithinDocument``."""

    frame_id: str
    url: str


class FrameEvent(Wire, frozen=True):
    """Events that only name a frame."""

    frame_id: str


class NavigationStarted(Wire, frozen=True):
    """``Page.frameStartedNavigating``."""

    frame_id: str
    loader_id: str


class FileChooser(Wire, frozen=True):
    """``Page.fileChooserOpened``: an ``<input type=file>`` wants files."""

    mode: str = "selectSingle"
    backend_node_id: int = 0


class ScheduledNavigation(Wire, frozen=True):
    """``Page.frameScheduledNavigation``; the delay in seconds."""

    frame_id: str
    url: str
    delay: float


class RequestedNavigation(Wire, frozen=True):
    """``Page.frameRequestedNavigation``."""

    frame_id: str
    url: str


class WindowOpen(Wire, frozen=True):
    """``Page.windowOpen``."""

    url: str


class Navigated(Wire, frozen=True):
    """``Page.navigate``."""

    frame_id: str
    loader_id: str = ""
    error_text: str = ""
    is_download: bool = False


class HistoryEntry(Wire, frozen=True):
    """One entry of the tab's history."""

    id: int
    url: str


class History(Wire, frozen=True):
    """``Page.getNavigationHistory``."""

    current_index: int
    entries: tuple[HistoryEntry, ...]


class DialogOpening(Wire, frozen=True):
    """``Page.javascriptDialogOpening``."""

    type: str
    message: str = ""
    default_prompt: str = ""


class DownloadWillBegin(Wire, frozen=True):
    """``Browser.downloadWillBegin``."""

    frame_id: str
    url: str
    suggested_filename: str = ""


class PostData(Wire, frozen=True):
    """A part of a request's body; base64 is decoded on the way in."""

    data: bytes = msgspec.field(default=b"", name="bytes")


class Request(Wire, frozen=True):
    """An HTTP request."""

    url: str = ""
    method: str = "GET"
    headers: dict[str, str] = {}
    post_data_entries: tuple[PostData, ...] = ()
    initial_priority: str = ""


class RequestWillBeSent(Wire, frozen=True):
    """``Network.requestWillBeSent``."""

    request_id: str
    loader_id: str = ""
    frame_id: str = ""
    type: str = ""
    document_url: str = msgspec.field(default="", name="documentURL")
    request: Request = Request()


class PriorityChanged(Wire, frozen=True):
    """``Network.resourceChangedPriority``."""

    request_id: str
    new_priority: str


class Response(Wire, frozen=True):
    """The head of an HTTP response."""

    status: int
    url: str = ""
    headers: dict[str, str] = {}


class ResponseReceived(Wire, frozen=True):
    """``Network.responseReceived``."""

    request_id: str
    loader_id: str
    type: str
    response: Response
    frame_id: str = ""


class SocketCreated(Wire, frozen=True):
    """``Network.webSocketCreated``."""

    request_id: str
    url: str


class RequestDone(Wire, frozen=True):
    """``Network.loadingFinished``, and others that only name a request."""

    request_id: str


class RequestFailed(Wire, frozen=True):
    """``Network.loadingFailed``."""

    request_id: str
    type: str = ""
    error_text: str = ""
    canceled: bool = False


class RequestPaused(Wire, frozen=True):
    """``Fetch.requestPaused``."""

    request_id: str
    request: Request
    frame_id: str = ""


class World(Wire, frozen=True):
    """``Page.createIsolatedWorld``."""

    execution_context_id: int


class RemoteObject(Wire, frozen=True):
    """A script's result, by value or as a handle."""

    type: str = ""
    value: msgspec.Raw = msgspec.Raw(b"null")
    description: str = ""
    object_id: str = ""


class ExceptionDetails(Wire, frozen=True):
    """Why a script did not end well."""

    text: str = ""
    exception: RemoteObject | None = None


class Evaluated(Wire, frozen=True):
    """``Runtime.evaluate``."""

    result: RemoteObject
    exception_details: ExceptionDetails | None = None


class Property(Wire, frozen=True):
    """One property of an object that there is a handle for."""

    name: str
    value: RemoteObject | None = None


class Properties(Wire, frozen=True):
    """``Runtime.getProperties``."""

    result: tuple[Property, ...] = ()


class ShadowRoot(Wire, frozen=True):
    """A shadow root of a described element."""

    backend_node_id: int
    shadow_root_type: str = ""


class Node(Wire, frozen=True):
    """A described element; ``frame_id`` of the frame that it holds."""

    frame_id: str = ""
    shadow_roots: tuple[ShadowRoot, ...] = ()


class Described(Wire, frozen=True):
    """``DOM.describeNode``."""

    node: Node


class Resolved(Wire, frozen=True):
    """``DOM.resolveNode``."""

    object: RemoteObject


class Screenshot(Wire, frozen=True):
    """``Page.captureScreenshot``; base64 is decoded on the way in."""

    data: bytes
