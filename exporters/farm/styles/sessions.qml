<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Dashed outline of each session, with its day and name where there is room. -->
<qgis version="3.34.0" styleCategories="Symbology|Labeling|MapTips|Temporal" labelsEnabled="1">
 <temporal enabled="1" mode="1" startField="start" endField="" startExpression="" endExpression="" durationField="" durationUnit="ms" fixedDuration="0" limitMode="0" accumulate="1">
  <fixedRange>
   <start></start>
   <end></end>
  </fixedRange>
 </temporal>
 <renderer-v2 type="singleSymbol" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="0,0,0,0"/>
      <Option name="style" type="QString" value="no"/>
      <Option name="outline_color" type="QString" value="90,90,90,255"/>
      <Option name="outline_style" type="QString" value="dash"/>
      <Option name="outline_width" type="QString" value="0.3"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <labeling type="simple">
  <settings calloutType="simple">
   <text-style fieldName="format_date(&quot;date&quot;, 'yyyy-MM-dd') || '\n' || &quot;name&quot;" isExpression="1" fontSize="9" fontSizeUnit="Point" fontFamily="Sans" textColor="40,40,40,255">
    <text-buffer bufferDraw="1" bufferSize="1" bufferSizeUnits="MM" bufferColor="255,255,255,220"/>
   </text-style>
  </settings>
 </labeling>
 <mapTip enabled="1">&lt;b&gt;[% "name" %]&lt;/b&gt;, [% format_date("date", 'yyyy-MM-dd') %]&lt;br&gt;[% coalesce("implement", '') %] [% coalesce(format_number("worked_area_m2", 0), '?') %] m² worked in [% "passes" %] passes, [% coalesce(format_number("overlap_area_m2", 0), '?') %] m² twice, [% coalesce(format_number("missed_area_m2", 0), '?') %] m² missed&lt;br&gt;[% coalesce(format_number("work_rate_ha_h", 2), '?') %] ha/h&lt;br&gt;[% "folder" %]</mapTip>
</qgis>
