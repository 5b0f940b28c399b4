"""The parts of the DevTools protocol's messages that WebGym reads. Names and structure are the protocol's."""

from __future__ import annotations

import msgspec


class CdpMessage(msgspec.Struct, frozen=True, rename="camel"):
    """Base: camelCase on the wire, unknown fields ignored."""


class _VisualViewport(CdpMessage, frozen=True):
    page_x: float
    page_y: float


class LayoutMetrics(CdpMessage, frozen=True):
    """``Page.getLayoutMetrics``: where in its document the viewport lies, CSS pixels."""

    css_visual_viewport: _VisualViewport


class EmptyReply(CdpMessage, frozen=True):
    """A reply or event whose content is ignored."""


class Version(CdpMessage, frozen=True):
    """``Browser.getVersion``."""

    product: str


class BrowserContext(CdpMessage, frozen=True):
    """``Target.createBrowserContext``."""

    browser_context_id: str


class CreatedTarget(CdpMessage, frozen=True):
    """``Target.createTarget``."""

    target_id: str


class Attached(CdpMessage, frozen=True):
    """``Target.attachToTarget``."""

    session_id: str


class TargetInfo(CdpMessage, frozen=True):
    """A page, worker or frame that can be attached to."""

    target_id: str
    type: str
    browser_context_id: str = ""
    opener_id: str = ""


class AttachedToTarget(CdpMessage, frozen=True):
    """``Target.attachedToTarget``."""

    session_id: str
    target_info: TargetInfo


class DetachedFromTarget(CdpMessage, frozen=True):
    """``Target.detachedFromTarget``."""

    session_id: str
    target_id: str = ""


class Frame(CdpMessage, frozen=True):
    """A frame of the page."""

    id: str
    loader_id: str
    url: str
    url_fragment: str = ""
    unreachable_url: str = ""


class FrameTreeNode(CdpMessage, frozen=True):
    """A frame of the page, without those within it."""

    frame: Frame


class FrameTree(CdpMessage, frozen=True):
    """``Page.getFrameTree``."""

    frame_tree: FrameTreeNode


class FrameAttached(CdpMessage, frozen=True):
    """``Page.frameAttached``."""

    frame_id: str
    parent_frame_id: str = ""


class FrameNavigated(CdpMessage, frozen=True):
    """``Page.frameNavigated``; its type tells a document that the back-forward cache has kept alive."""

    frame: Frame
    type: str = ""


class NavigatedWithinDocument(CdpMessage, frozen=True):
    """``Page.navigatedWithinDocument``."""

    frame_id: str
    url: str


class FrameEvent(CdpMessage, frozen=True):
    """An event of which only the frame's id is read."""

    frame_id: str


class NavigationStarted(CdpMessage, frozen=True):
    """``Page.frameStartedNavigating``."""

    frame_id: str
    loader_id: str
    url: str = ""


class FileChooser(CdpMessage, frozen=True):
    """``Page.fileChooserOpened``: an ``<input type=file>`` asks for files; without a node, a script does
    by the File System API."""

    mode: str = "selectSingle"
    backend_node_id: int = 0


class ScheduledNavigation(CdpMessage, frozen=True):
    """``Page.frameScheduledNavigation``; the delay in seconds."""

    frame_id: str
    url: str
    delay: float


class RequestedNavigation(CdpMessage, frozen=True):
    """``Page.frameRequestedNavigation``."""

    frame_id: str
    url: str


class Navigated(CdpMessage, frozen=True):
    """``Page.navigate``."""

    loader_id: str = ""
    error_text: str = ""
    is_download: bool = False


class HistoryEntry(CdpMessage, frozen=True):
    """One entry of the tab's history."""

    id: int
    url: str


class History(CdpMessage, frozen=True):
    """``Page.getNavigationHistory``."""

    current_index: int
    entries: tuple[HistoryEntry, ...]


class DialogOpening(CdpMessage, frozen=True):
    """``Page.javascriptDialogOpening``."""

    type: str
    message: str = ""
    default_prompt: str = ""


class DownloadWillBegin(CdpMessage, frozen=True):
    """``Browser.downloadWillBegin``."""

    url: str
    suggested_filename: str = ""


class PostData(CdpMessage, frozen=True):
    """A part of a request's body, decoded from base64."""

    data: bytes = msgspec.field(default=b"", name="bytes")


class Request(CdpMessage, frozen=True):
    """An HTTP request."""

    url: str = ""
    method: str = "GET"
    post_data_entries: tuple[PostData, ...] = ()
    initial_priority: str = ""


class RequestWillBeSent(CdpMessage, frozen=True):
    """``Network.requestWillBeSent``."""

    request_id: str
    loader_id: str = ""
    frame_id: str = ""
    type: str = ""
    document_url: str = msgspec.field(default="", name="documentURL")
    request: Request = Request()


class PriorityChanged(CdpMessage, frozen=True):
    """``Network.resourceChangedPriority``."""

    request_id: str
    new_priority: str


class Response(CdpMessage, frozen=True):
    """The head of an HTTP response."""

    status: int
    url: str = ""
    headers: dict[str, str] = {}


class ResponseReceived(CdpMessage, frozen=True):
    """``Network.responseReceived``."""

    request_id: str
    loader_id: str
    type: str
    response: Response
    frame_id: str = ""


class SocketCreated(CdpMessage, frozen=True):
    """``Network.webSocketCreated``."""

    request_id: str
    url: str


class RequestDone(CdpMessage, frozen=True):
    """``Network.loadingFinished``, and other events of which only the request's id is read."""

    request_id: str


class DataReceived(CdpMessage, frozen=True):
    """``Network.dataReceived``: bytes of a body, as they were sent."""

    request_id: str
    encoded_data_length: int = 0


class RequestFailed(CdpMessage, frozen=True):
    """``Network.loadingFailed``."""

    request_id: str
    type: str = ""
    error_text: str = ""
    canceled: bool = False


class Header(CdpMessage, frozen=True):
    """A header of a response."""

    name: str
    value: str


class RequestPaused(CdpMessage, frozen=True):
    """``Fetch.requestPaused``, before it is sent or, with a status or an error, at its response."""

    request_id: str
    request: Request
    frame_id: str = ""
    resource_type: str = ""
    response_status_code: int = 0
    response_error_reason: str = ""
    response_headers: tuple[Header, ...] = ()

    @property
    def is_response(self) -> bool:
        """Whether it is paused at its response."""
        return bool(self.response_status_code or self.response_error_reason)


class AuthChallenge(CdpMessage, frozen=True):
    """Who asks for a user name and a password."""

    origin: str
    source: str = ""


class AuthRequired(CdpMessage, frozen=True):
    """``Fetch.authRequired``."""

    request_id: str
    auth_challenge: AuthChallenge


class CertificateError(CdpMessage, frozen=True):
    """``Security.certificateError``."""

    event_id: int
    error_type: str
    request_url: str = msgspec.field(name="requestURL")


class World(CdpMessage, frozen=True):
    """``Page.createIsolatedWorld``."""

    execution_context_id: int


class RemoteObject(CdpMessage, frozen=True):
    """A script's result, by value or as a handle."""

    value: msgspec.Raw = msgspec.Raw(b"null")
    description: str = ""
    object_id: str = ""


class ExceptionDetails(CdpMessage, frozen=True):
    """Why a script failed."""

    text: str = ""
    exception: RemoteObject | None = None


class Evaluated(CdpMessage, frozen=True):
    """``Runtime.evaluate``."""

    result: RemoteObject
    exception_details: ExceptionDetails | None = None


class Property(CdpMessage, frozen=True):
    """One property of a remote object."""

    name: str
    value: RemoteObject | None = None


class Properties(CdpMessage, frozen=True):
    """``Runtime.getProperties``."""

    result: tuple[Property, ...] = ()


class ShadowRoot(CdpMessage, frozen=True):
    """A shadow root of a described element."""

    backend_node_id: int
    shadow_root_type: str = ""


class Window(CdpMessage, frozen=True):
    """``Browser.getWindowForTarget``."""

    window_id: int


class Node(CdpMessage, frozen=True):
    """A described element; ``frame_id`` is that of the frame that it contains."""

    local_name: str = ""
    frame_id: str = ""
    shadow_roots: tuple[ShadowRoot, ...] = ()


class Described(CdpMessage, frozen=True):
    """``DOM.describeNode``."""

    node: Node


class Resolved(CdpMessage, frozen=True):
    """``DOM.resolveNode``."""

    object: RemoteObject


class Screenshot(CdpMessage, frozen=True):
    """``Page.captureScreenshot``, decoded from base64."""

    data: bytes
